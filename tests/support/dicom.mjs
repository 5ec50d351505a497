// DICOM files written by the tests, nothing identifying.
/** One slice of side x side voxels of two bytes, uncompressed, at z mm. */
export function dicomSlice(side, z = 0, { series = '1.2.3.5', number = 0, description = '', time = '' } = {}) {
  const element = (group, number, vr, value) => {
    let body = Buffer.isBuffer(value) ? value : Buffer.from(value, 'latin1');
    if (body.length % 2) body = Buffer.concat([body, Buffer.from(vr === 'UI' ? '\0' : ' ')]);
    const wide = vr === 'OB' || vr === 'OW', head = Buffer.alloc(wide ? 12 : 8);
    head.writeUInt16LE(group, 0);
    head.writeUInt16LE(number, 2);
    head.write(vr, 4);
    if (wide) head.writeUInt32LE(body.length, 8);
    else head.writeUInt16LE(body.length, 6);
    return Buffer.concat([head, body]);
  };
  const us = (value) => Buffer.from([value & 255, value >> 8]);
  const ct = '1.2.840.10008.5.1.4.1.1.2';
  const meta = Buffer.concat([element(2, 1, 'OB', Buffer.from([0, 1])), element(2, 2, 'UI', ct), element(2, 3, 'UI', '1.2.3.4'), element(2, 0x10, 'UI', '1.2.840.10008.1.2.1')]);
  const size = Buffer.alloc(4);
  size.writeUInt32LE(meta.length);
  return Buffer.concat([Buffer.alloc(128), Buffer.from('DICM'), element(2, 0, 'UL', size), meta,
    element(8, 0x16, 'UI', ct), element(8, 0x18, 'UI', `1.2.3.4.${z}`), ...(time ? [element(8, 0x20, 'DA', '20260131'), element(8, 0x31, 'TM', time)] : []), element(8, 0x60, 'CS', 'CT'), element(8, 0x103e, 'LO', description),
    element(0x10, 0x10, 'PN', 'SECRET^NAME'), element(0x20, 0xd, 'UI', '1.2.3'), element(0x20, 0xe, 'UI', series), element(0x20, 0x11, 'IS', String(number)),
    element(0x20, 0x32, 'DS', `0\\0\\${z}`), element(0x20, 0x37, 'DS', '1\\0\\0\\0\\1\\0'), element(0x28, 2, 'US', us(1)), element(0x28, 4, 'CS', 'MONOCHROME2'),
    element(0x28, 0x10, 'US', us(side)), element(0x28, 0x11, 'US', us(side)), element(0x28, 0x30, 'DS', '1\\1'), element(0x28, 0x100, 'US', us(16)),
    element(0x28, 0x101, 'US', us(16)), element(0x28, 0x102, 'US', us(15)), element(0x28, 0x103, 'US', us(0)), element(0x7fe0, 0x10, 'OW', Buffer.alloc(2 * side * side, 7))]);
}
