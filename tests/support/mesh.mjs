// Meshes for tests.

// n triangles across y, each larger than a picture of the test's ball, as binary STL.
export function panesStl(n) {
  const bytes = Buffer.alloc(84 + 50 * n);
  bytes.writeUInt32LE(n, 80);
  for (let i = 0; i < n; i++)
    [-260, -140, 340, -140, 41, 460].forEach((number, k) => {
      const at = 84 + 50 * i + 12 + 12 * (k >> 1);
      bytes.writeFloatLE(number, at + (k & 1 ? 8 : 0));
      bytes.writeFloatLE(21 + (60 * i) / n, at + 4);
    });
  return bytes;
}

// A ball about `centre` of 4 n² triangles, as binary STL.
export function ballStl(n, radius = 20, centre = [41, 51, 61]) {
  const at = (u, v) => {
    const a = (Math.PI * u) / n;
    const b = (Math.PI * (v % (2 * n))) / n;
    return u === 0 || u === n
      ? [centre[0], centre[1], centre[2] + (u ? -radius : radius)]
      : [centre[0] + radius * Math.sin(a) * Math.cos(b), centre[1] + radius * Math.sin(a) * Math.sin(b), centre[2] + radius * Math.cos(a)];
  };
  const bytes = Buffer.alloc(84 + 50 * 4 * n * n);
  bytes.writeUInt32LE(4 * n * n, 80);
  let to = 84;
  for (let u = 0; u < n; u++)
    for (let v = 0; v < 2 * n; v++)
      for (const corners of [[at(u, v), at(u + 1, v), at(u + 1, v + 1)], [at(u, v), at(u + 1, v + 1), at(u, v + 1)]]) {
        corners.flat().forEach((number, i) => bytes.writeFloatLE(number, to + 12 + 4 * i));
        to += 50;
      }
  return bytes;
}
