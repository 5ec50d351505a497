// A minimal patient on a table.
const SIDE = 48;
const within = (x, y, cx, cy, r) => (x - cx) ** 2 + (y - cy) ** 2 < r * r;

/** A trunk of soft tissue with a bone in front, on a table, in Hounsfield units, as NRRD. */
export function patient(spacing) {
  const text =
    `NRRD0004\ntype: int16\ndimension: 3\nspace: left-posterior-superior\nsizes: ${SIDE} ${SIDE} ${SIDE}\n` +
    `space directions: (${spacing},0,0) (0,${spacing},0) (0,0,${spacing})\nendian: little\nencoding: raw\n\n`;
  const voxels = Buffer.alloc(2 * SIDE ** 3);
  for (let i = 0; i < SIDE ** 3; i++) {
    const [x, y] = [i % SIDE, Math.floor(i / SIDE) % SIDE];
    const table = y === 44 || y === 45;
    const body = within(x, y, 24, 24, 14) ? (within(x, y, 24, 13, 4) ? 900 : 60) : -1000;
    voxels.writeInt16LE(table ? 200 : body, 2 * i);
  }
  return Buffer.concat([Buffer.from(text), voxels]);
}
