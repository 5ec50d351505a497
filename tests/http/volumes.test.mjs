// Volumes: listing, loading by path, upload, looking into them, deleting.
import assert from 'node:assert/strict';
import { readdirSync } from 'node:fs';
import { mkdirSync, rmSync, symlinkSync, writeFileSync } from 'node:fs';
import http from 'node:http';
import { join } from 'node:path';
import { deflateSync, gzipSync } from 'node:zlib';
import { after, before, test } from 'node:test';
import { ballNrrd, Daemon, problem, sleep, until } from '../support/daemon.mjs';
import { dicomSlice } from '../support/dicom.mjs';
import { Ws } from '../support/ws.mjs';
import { crc32, zip } from '../../web/zip.js';

let d, spool;
before(async () => {
  d = await Daemon.start({ files: { 'broken.nrrd': 'NRRD0004\ntype: uint8\n\n', 'notes.txt': 'hello' }, config: '[limits]\nupload_bytes=200000\nvolume_bytes=400000\n[server]\nspool=/dev/shm\n' });
  spool = () => readdirSync('/dev/shm').filter((name) => name.startsWith('tomocast-upload-'));
  mkdirSync(join(d.folder, 'deep'));
  writeFileSync(join(d.folder, 'deep', 'inner.nrrd'), ballNrrd(8));
  writeFileSync(join(d.folder, 'deep', 'packed.nrrd.gz'), gzipSync(ballNrrd(8)));
  mkdirSync(join(d.folder, 'series'));
  const slice = Buffer.alloc(200);
  slice.write('DICM', 128);
  for (const name of ['IM1', 'IM2']) writeFileSync(join(d.folder, 'series', name), slice);
  mkdirSync(join(d.folder, 'other'));
  writeFileSync(join(d.folder, 'other', 'README'), 'no picture');
  symlinkSync('/etc/hostname', join(d.folder, 'out.nrrd'));
});
after(() => d.stop());

const upload = (id, body) => d.call('PUT', `/v1/volumes/${id}`, { body, type: 'application/octet-stream' });

// Files go on a thread of the spool's own.
const swept = () => until(() => spool().length === 0);

const settled = (id) => d.loaded(`/v1/volumes/${id}`);

// Three volumes of one value each.
const timeNrrd = () =>
  Buffer.concat([
    Buffer.from('NRRD0004\ntype: uint8\ndimension: 4\nsizes: 4 4 4 3\nkinds: domain domain domain time\nencoding: raw\n\n'),
    ...[10, 20, 30].map((value) => Buffer.alloc(64, value)),
  ]);

test('#volume=N chooses a volume of a file; which one it is, is said', async () => {
  writeFileSync(join(d.folder, 'time.nrrd'), timeNrrd());
  for (const [id, suffix, volume] of [['first', '', 1], ['third', '#volume=3', 3]]) {
    await d.post('/v1/volumes', { id, path: `time.nrrd${suffix}` });
    const json = await settled(id);
    assert.equal(json.state, 'resident', json.reason);
    assert.deepEqual([json.volume, json.frames, json.range], [volume, 3, [10 * volume, 10 * volume]]);
    assert.match(json.note, new RegExp(`volume ${volume} of 3`));
    assert.equal((await d.call('DELETE', `/v1/volumes/${id}`)).status, 204);
  }
  await d.post('/v1/volumes', { id: 'fourth', path: 'time.nrrd#volume=4' });
  assert.match((await settled('fourth')).reason, /no volume 4: the file holds 3/);
  await d.call('DELETE', '/v1/volumes/fourth');
  rmSync(join(d.folder, 'time.nrrd'));
});

test('of a file of several volumes another is loaded without its path, an upload as well, and a session steps through them', async () => {
  await upload('time', timeNrrd());
  assert.equal((await settled('time')).state, 'resident');
  assert.equal(spool().length, 1); // for as long as one of its volumes is there
  const another = (id, of, volume) => d.post('/v1/volumes', { id, of, volume });
  problem(await another('x', 'time', 4), 422, '/volume');
  problem(await another('x', 'time', 1.5), 422, '/volume');
  problem(await another('x', 'ball', 1), 422, '/volume');
  problem(await another('x', 'nothing', 1), 404, '/of');
  assert.equal((await another('time.3', 'time', 3)).status, 202);
  const third = await settled('time.3');
  assert.deepEqual([third.state, third.volume, third.of, third.range], ['resident', 3, 'time', [30, 30]], third.reason);
  await another('time.2', 'time.3', 2);
  assert.equal((await settled('time.2')).of, 'time');
  const { volumes } = (await d.get('/v1/volumes/time')).json;
  assert.deepEqual(volumes.sort((a, b) => a.volume - b.volume), [1, 2, 3].map((volume) => ({ id: volume > 1 ? `time.${volume}` : 'time', volume, state: 'resident' })));

  const scene = { mode: 'mpr', image: { width: 16, height: 16 }, window: { center: 15, width: 30 }, mpr: { zoom: 2 } };
  const { id } = (await d.post('/v1/sessions', { volume: 'time', scene })).json;
  const ws = await Ws.open(d, id);
  const before = (await ws.next(({ header }) => header?.final)).header;
  assert.equal(before.volume, 'time');
  const kept = (await d.get(`/v1/sessions/${id}/scene`)).json;
  const show = (volume) => d.call('PATCH', `/v1/sessions/${id}`, { json: { volume } });
  problem(await show('nothing'), 404, '/volume');
  problem(await d.call('PATCH', `/v1/sessions/${id}`, { json: { scene: {} } }), 422, '/scene');
  const shown = await show('time.3');
  assert.deepEqual([shown.status, shown.json.volume, shown.json.scene], [200, 'time.3', kept]);
  const after = (await ws.next(({ header }) => header?.final && header.volume === 'time.3')).header;
  assert.equal(after.others, before.others); // the scene is the one it was
  ws.close();
  assert.equal((await d.call('DELETE', '/v1/volumes/time.3')).status, 409);
  assert.equal((await d.call('DELETE', '/v1/volumes/time')).status, 204);
  assert.equal(spool().length, 1);
  await d.call('DELETE', `/v1/sessions/${id}`);
  for (const volume of ['time.2', 'time.3']) assert.equal((await d.call('DELETE', `/v1/volumes/${volume}`)).status, 204);
  await swept();
});

/** A grey PNG of 8 bits. */
function greyPng(width, rows) {
  const chunk = (type, data) => {
    const body = Buffer.concat([Buffer.from(type), data]), all = Buffer.alloc(8 + body.length);
    all.writeUInt32BE(data.length);
    body.copy(all, 4);
    all.writeUInt32BE(crc32(body), 4 + body.length);
    return all;
  };
  const head = Buffer.alloc(13);
  head.writeUInt32BE(width);
  head.writeUInt32BE(rows.length, 4);
  head[8] = 8;
  const pixels = deflateSync(Buffer.concat(rows.map((row) => Buffer.from([0, ...row]))));
  return Buffer.concat([Buffer.from('\x89PNG\r\n\x1a\n', 'latin1'), chunk('IHDR', head), chunk('IDAT', pixels), chunk('IEND', Buffer.alloc(0))]);
}

test('pictures are volumes: a folder, a zip, a spacing that a client gives', async () => {
  mkdirSync(join(d.folder, 'stack'));
  const page = (value) => greyPng(3, [[value, 1, 2], [3, 4, 255]]);
  for (const n of [2, 10, 9]) writeFileSync(join(d.folder, 'stack', `slice ${n}.png`), page(n));
  assert.ok((await d.get('/v1/volumes')).json.available.some(({ path }) => path === 'stack'));
  await d.post('/v1/volumes', { id: 'stack', path: 'stack#spacing=0.5,0.25,4' });
  const stack = await settled('stack');
  assert.deepEqual([stack.dims, stack.spacing, stack.type, stack.format, stack.range], [[3, 2, 3], [0.5, 0.25, 4], 'u8', 'pictures', [1, 255]], stack.reason);
  for (const [z, value] of [2, 9, 10].entries()) // numbers in names are numbers
    assert.equal((await d.get(`/v1/volumes/stack/value?at=0,0,${4 * z}`)).json.value, value);
  const plain = await d.call('PUT', '/v1/volumes/one?spacing=1,2,3', { body: page(7), type: 'application/octet-stream' });
  assert.equal(plain.status, 202);
  assert.deepEqual((await settled('one')).spacing, [1, 2, 3]);
  const packed = await zip(['b10.png', 'b9.png'].map((name, i) => new File([page(i)], name)));
  assert.equal((await upload('packed', Buffer.from(await packed.arrayBuffer()))).status, 202);
  const two = await settled('packed');
  assert.deepEqual([two.dims, two.spacing], [[3, 2, 2], [1, 1, 1]], two.reason);
  assert.match(two.note, /no spacing: 1 mm assumed/);
  assert.equal((await d.get('/v1/volumes/packed/value?at=0,0,0')).json.value, 1); // b9 before b10
  const mhd = 'ObjectType = Image\nNDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\nElementDataFile = v.raw\n';
  const pair = await zip([new File([Buffer.from([0, 1, 2, 3, 4, 5, 6, 7])], 'v.raw'), new File([mhd], 'v.mhd')]);
  assert.equal((await upload('pair', Buffer.from(await pair.arrayBuffer()))).status, 202);
  const put = await settled('pair');
  assert.deepEqual(put.range, [0, 7], put.reason);
  problem(await d.call('PUT', '/v1/volumes/x?spacing=1%232', { body: page(1), type: 'application/octet-stream' }), 422);
  for (const id of ['stack', 'one', 'packed', 'pair']) await d.call('DELETE', `/v1/volumes/${id}`);
  rmSync(join(d.folder, 'stack'), { recursive: true });
});

test('a resident volume tells its geometry', async () => {
  const { json } = await d.get('/v1/volumes/ball');
  assert.deepEqual([json.state, json.dims, json.spacing, json.origin, json.type, json.bytes],
    ['resident', [32, 32, 32], [2, 2, 2], [10, 20, 30], 'u8', 32768]);
  assert.deepEqual(json.direction, [[1, 0, 0], [0, 1, 0], [0, 0, 1]]);
  assert.equal(json.range[0], 0);
  assert.ok(json.range[1] > 200 && json.range[1] <= 255);
});

test('the list has resident and available volumes, and nothing else', async () => {
  const { json } = await d.get('/v1/volumes');
  assert.deepEqual(json.volumes.map(({ id }) => id).includes('ball'), true);
  const paths = json.available.map(({ path }) => path);
  assert.deepEqual(paths.filter((path) => !path.startsWith('demo:')), ['ball.nrrd', 'broken.nrrd', 'deep/inner.nrrd', 'deep/packed.nrrd.gz', 'series']);
  assert.ok(paths.includes('demo:head'));
});

test('a file of the data folder is loaded: 202, then resident', async () => {
  const reply = await d.post('/v1/volumes', { id: 'inner', path: 'deep/inner.nrrd' });
  assert.equal(reply.status, 202);
  assert.equal(reply.headers.get('location'), '/v1/volumes/inner');
  assert.equal((await settled('inner')).state, 'resident');
  problem(await d.post('/v1/volumes', { id: 'inner', path: 'deep/inner.nrrd' }), 409, '/id');
  assert.equal((await d.delete('/v1/volumes/inner')).status, 204);
  problem(await d.get('/v1/volumes/inner'), 404);
});

test('a broken file fails with a reason that holds no server path, and its id may be used again', async () => {
  assert.equal((await d.post('/v1/volumes', { id: 'again', path: 'broken.nrrd' })).status, 202);
  const failed = await settled('again');
  assert.equal(failed.state, 'failed');
  assert.ok(failed.reason.length > 5);
  assert.ok(!failed.reason.includes(d.folder), failed.reason);
  assert.match(failed.reason, /^open broken\.nrrd: /);
  problem(await d.post('/v1/sessions', { volume: 'again' }), 409, '/volume');
  problem(await d.post('/v1/render', { volume: 'none' }), 404, '/volume');
  assert.equal((await d.post('/v1/volumes', { id: 'again', path: 'ball.nrrd' })).status, 202);
  assert.equal((await settled('again')).state, 'resident');
  await d.delete('/v1/volumes/again');
});

test('nothing outside the data folder can be named', async () => {
  for (const path of ['/etc/hostname', '../../etc/hostname', 'deep/../../x', 'out.nrrd', 'missing.nrrd', '.', '..', '#1', 'deep/../../../etc/passwd#1']) {
    const reply = await d.post('/v1/volumes', { id: 'escape', path });
    if (reply.status === 202) { // a folder inside: there is no DICOM in it
      assert.ok(['.', '#1'].includes(path), path);
      assert.equal((await settled('escape')).state, 'failed');
    } else {
      problem(reply, 404, '/path');
    }
  }
  problem(await d.post('/v1/volumes', { id: 'escape', path: '' }), 422, '/path');
});

test('bad load requests name what is wrong', async () => {
  problem(await d.post('/v1/volumes', { id: 'x', path: 'ball.nrrd', more: 1 }), 422, '/more');
  problem(await d.post('/v1/volumes', { path: 'ball.nrrd' }), 422, '/id');
  problem(await d.post('/v1/volumes', { id: 'x' }), 422, '/path');
  problem(await d.post('/v1/volumes', { id: 7, path: 'ball.nrrd' }), 422, '/id');
  problem(await d.post('/v1/volumes', [1]), 422);
  for (const id of ['', '.', '..', 'a/b', 'a b', 'é', 'x'.repeat(65)]) problem(await d.post('/v1/volumes', { id, path: 'ball.nrrd' }), 422, '/id');
  problem(await d.call('POST', '/v1/volumes', { body: '{', type: 'application/json' }), 400);
  problem(await d.call('POST', '/v1/volumes', { body: '{}', type: 'text/plain' }), 415);
  for (const [method, path] of [['POST', ''], ['PUT', '/packed']])
    problem(await d.call(method, `/v1/volumes${path}`, { body: '{}', type: 'application/json', headers: { 'content-encoding': 'gzip' } }), 415);
});

test('an upload becomes a volume and leaves no file', async () => {
  const reply = await upload('up', ballNrrd(40));
  assert.equal(reply.status, 202);
  const volume = await settled('up');
  assert.deepEqual([volume.state, volume.dims], ['resident', [40, 40, 40]]);
  assert.deepEqual(spool(), []);
  problem(await upload('up', ballNrrd(8)), 409);
  await d.delete('/v1/volumes/up');
});

test('an upload that is no volume fails; one that names another file is refused', async () => {
  assert.equal((await upload('junk', Buffer.alloc(1000, 7))).status, 202);
  assert.equal((await settled('junk')).state, 'failed');
  for (const text of ['NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: raw\ndata file: /etc/hostname\n\n',
    'NRRD0004\r\nData File : /etc/hostname\r\n\r\n', 'ObjectType = Image\nNDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\nElementDataFile = /etc/hostname\n']) {
    assert.equal((await upload('spy', text)).status, 202);
    const volume = await settled('spy');
    assert.equal(volume.state, 'failed');
    assert.match(volume.reason, /names another file/);
  }
  assert.deepEqual(spool(), []);
});

test('uploads over the limit are refused before they are read, or as they pass it', async () => {
  const text = await d.raw(`PUT /v1/volumes/huge HTTP/1.1\r\nHost: 127.0.0.1:${d.port}\r\nContent-Length: 99999999999\r\n\r\n`);
  assert.match(text, /^HTTP\/1\.1 413 /);
  async function* pieces() { for (let i = 0; i < 30; i++) yield Buffer.alloc(10000); }
  const reply = await fetch(`${d.base}/v1/volumes/huge`, { method: 'PUT', body: pieces(), duplex: 'half' });
  assert.equal(reply.status, 413);
  await swept();
  problem(await d.get('/v1/volumes/huge'), 404);
});

test('an upload that breaks off leaves nothing', async () => {
  await d.raw(`PUT /v1/volumes/cut HTTP/1.1\r\nHost: 127.0.0.1:${d.port}\r\nContent-Length: 100000\r\n\r\nNRRD0004\n`, 300);
  await swept();
  problem(await d.get('/v1/volumes/cut'), 404);
});

test('the memory budget is kept', async () => {
  const { limits } = (await d.get('/v1/about')).json;
  assert.equal(limits.volumeBytes, 400000);
  await upload('big1', ballNrrd(52));
  assert.equal((await settled('big1')).state, 'resident');
  await upload('big2', ballNrrd(52));
  assert.equal((await settled('big2')).state, 'resident');
  for (const id of ['ball', 'big1', 'big2']) assert.equal((await d.post('/v1/sessions', { volume: id })).status, 201);
  await upload('big3', ballNrrd(52));
  const third = await settled('big3');
  assert.equal(third.state, 'failed', JSON.stringify(third));
  assert.match(third.reason, /memory is used up: .*volumes 0\.\d/);
  for (const { id } of (await d.get('/v1/sessions')).json.sessions) await d.delete(`/v1/sessions/${id}`);
  for (const id of ['big1', 'big2', 'big3']) await d.delete(`/v1/volumes/${id}`);
  assert.equal(await d.metric('volume_resident_bytes'), 32768);
});

test('histogram counts every voxel', async () => {
  const { json } = await d.get('/v1/volumes/ball/histogram?bins=32');
  assert.equal(json.counts.length, 32);
  assert.equal(json.edges.length, 33);
  assert.equal(json.counts.reduce((a, b) => a + b), 32768);
  for (const bins of ['0', '-1', '65537', 'many', '']) problem(await d.get(`/v1/volumes/ball/histogram?bins=${bins}`), 422);
});

test('the value at a patient coordinate', async () => {
  const at = async (x, y, z) => (await d.get(`/v1/volumes/ball/value?at=${x},${y},${z}`)).json.value;
  assert.equal(await at(10, 20, 30), 0); // voxel 0,0,0
  assert.ok((await at(41, 51, 61)) > 200); // the middle
  assert.equal(await at(9, 20, 30), null); // outside
  for (const text of ['1,2', '1,2,3,4', 'a,b,c', '1,2,nan', '']) problem(await d.get(`/v1/volumes/ball/value?at=${text}`), 422);
  problem(await d.get('/v1/volumes/ball/value'), 422);
});

test('who floods the list of series does not keep it from others', async () => {
  const folder = join(d.folder, 'many');
  mkdirSync(folder);
  for (let z = 0; z < 20; z++) writeFileSync(join(folder, `IM${z}`), dicomSlice(8, z));
  let answered = 0;
  const flood = [];
  const ask = (localAddress) => new Promise((resolve, reject) => {
    const request = http.get({ port: d.port, host: '127.0.0.1', localAddress, path: '/v1/series?path=many', agent: false, headers: { host: `127.0.0.1:${d.port}` } },
      (reply) => reply.resume().on('end', () => { answered++; resolve(reply.statusCode); })).on('error', reject);
    flood.push(request);
  });
  for (let i = 0; i < 60; i++) ask('127.0.0.1').catch(() => {});
  while ((await d.metric('work_queue_length{worker="walk"}')) < 40) assert.ok(answered < 20, 'they wait');
  assert.equal(await ask('127.0.0.2'), 200);
  assert.ok(answered < 50, `${answered - 1} others came first`);
  for (const request of flood) request.destroy();
  while (await d.metric('work_queue_length{worker="walk"}')) await sleep(10);
});

test('series of a folder are listed as a radiologist knows them; whose they are is told only where it is switched on', async () => {
  const folder = join(d.folder, 'study');
  mkdirSync(folder);
  for (const [number, description, images, time] of [[2, 'Thorax 1.0', 3, '140322.5'], [3, 'Abdomen', 2, '1410']])
    for (let z = 0; z < images; z++)
      writeFileSync(join(folder, `IM${number}${z}`), dicomSlice(8, z, { series: `1.2.3.${number}`, number, description, time }));
  const { json } = await d.get('/v1/series?path=study');
  const known = json.series.map(({ number, description, modality, frames, time, patient }) => ({ number, description, modality, frames, time, patient }));
  assert.deepEqual(known, [
    { number: 1, description: 'Thorax 1.0', modality: 'CT', frames: 3, time: '14:03:22', patient: undefined },
    { number: 2, description: 'Abdomen', modality: 'CT', frames: 2, time: '14:10', patient: undefined },
  ]);
  assert.doesNotMatch(JSON.stringify(json), /SECRET|2026/);
  await d.post('/v1/volumes', { id: 'abdomen', path: 'study#2' });
  const abdomen = await settled('abdomen');
  assert.deepEqual([abdomen.description, abdomen.time], ['Abdomen', '14:10']);
  problem(await d.get('/v1/series'), 422);
  problem(await d.get('/v1/series?path=nowhere'), 404);
  assert.ok(problem(await d.get('/v1/series?path=other'), 415).detail);
  assert.deepEqual((await d.get('/v1/series?path=deep/inner.nrrd')).json.series, []);
  const open = await Daemon.start({ ball: false, files: { 'a.dcm': dicomSlice(8, 0, { description: 'Thorax', time: '140322' }) }, config: '[limits]\npatient_tags=1\n' });
  const told = (await open.get('/v1/series?path=a.dcm')).json.series[0];
  assert.deepEqual([told.time, told.patient], ['2026-01-31 14:03:22', 'SECRET^NAME']);
  await open.stop();
});

test('a bridged slice is marked in the description and in pictures', async () => {
  mkdirSync(join(d.folder, 'gap'));
  for (const z of [0, 1, 2, 4, 5]) writeFileSync(join(d.folder, 'gap', `IM${z}`), dicomSlice(8, z));
  await d.post('/v1/volumes', { id: 'gap', path: 'gap' });
  const { bridged, dims, slices, note } = await settled('gap');
  assert.deepEqual({ bridged, layers: dims[2], slices }, { bridged: 4, layers: 6, slices: { used: 5, found: 5 } });
  assert.match(note, /1 missing slice bridged/);
  const picture = async (volume) => d.post('/v1/render', { volume, scene: { image: { width: 32, height: 32 } } });
  assert.equal((await picture('gap')).headers.get('tomocast-bridged'), '4');
  assert.equal((await picture('ball')).headers.get('tomocast-bridged'), null);
  for (const [volume, layer] of [['gap', 4], ['ball', undefined]]) {
    const ws = await Ws.open(d, (await d.post('/v1/sessions', { volume })).json.id);
    assert.equal((await ws.nextFrame()).header.bridged, layer);
    await ws.close();
  }
  await d.delete('/v1/volumes/gap?force=true');
  rmSync(join(d.folder, 'gap'), { recursive: true });
});

test('deleting: 404, 409 while in use, force', async () => {
  problem(await d.delete('/v1/volumes/none'), 404);
  await upload('used', ballNrrd(16));
  await settled('used');
  const { json: session } = await d.post('/v1/sessions', { volume: 'used' });
  problem(await d.delete('/v1/volumes/used'), 409);
  assert.equal((await d.delete('/v1/volumes/used?force=true')).status, 204);
  problem(await d.get(session.links.self), 404);
});
