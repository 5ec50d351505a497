// The results as one self-contained page: no script, no address of anything outside it.
import { barPlot, escape, linePlot } from './svg.mjs';

const GOAL = 1.2; // p99 beside a bad client over p99 beside one more ordinary client
const MOST_LINES = 16;

const show = (value, digits = 0) => (value === null || value === undefined ? '–' : typeof value === 'number' ? value.toFixed(digits) : String(value));
const STYLE = `
:root{color-scheme:light dark;--ink:#1b2430;--soft:#5d6b7c;--line:#d9dfe7;--paper:#f5f7fa;--card:#fff;--good:#1a7f4b;--bad:#b3261e;
--c0:#2563a8;--c1:#c2570c;--c2:#2e7d4f;--c3:#8a3ffc;--c4:#b3261e;--c5:#0f7c86;--c6:#946200;--c7:#6b7280}
@media (prefers-color-scheme:dark){:root{--ink:#e6ebf2;--soft:#97a3b4;--line:#313b49;--paper:#12171e;--card:#1a212b;--good:#4fc08a;--bad:#ff8a80;
--c0:#6fb1f5;--c1:#f0a35e;--c2:#6fcf97;--c3:#b794ff;--c4:#ff8a80;--c5:#5ad1da;--c6:#e2b93b;--c7:#9aa5b1}}
*{box-sizing:border-box}body{margin:0 auto;max-width:1500px;padding:28px 32px 60px;background:var(--paper);color:var(--ink);
font:15px/1.5 system-ui,"Segoe UI",Roboto,"DejaVu Sans",sans-serif}
h1{font-size:26px;margin:0 0 2px}h2{font-size:18px;margin:34px 0 10px}h3{font-size:13px;margin:0 0 4px;color:var(--soft);font-weight:600}
p{margin:4px 0;max-width:110ch}.soft,.none{color:var(--soft)}
.card{background:var(--card);border:1px solid var(--line);border-radius:10px;padding:14px 16px}.scroll{overflow-x:auto}
.plots{display:grid;grid-template-columns:repeat(auto-fit,minmax(330px,1fr));gap:14px;margin-top:12px}
.facts{display:flex;flex-wrap:wrap;gap:8px 30px;margin:0}.facts div{min-width:92px}.facts b{display:block;font-size:21px;font-weight:600;font-variant-numeric:tabular-nums}
.facts span{color:var(--soft);font-size:12.5px}
table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums;font-size:13.5px}th,td{padding:6px 10px;text-align:right;white-space:nowrap;border-bottom:1px solid var(--line)}
th{color:var(--soft);font-weight:600;font-size:12.5px;vertical-align:bottom}th:first-child,td:first-child{text-align:left}tr:last-child td{border-bottom:0}
td small{display:block;color:var(--soft);white-space:normal;min-width:190px;max-width:300px;line-height:1.3}.good{color:var(--good);font-weight:600}.bad{color:var(--bad);font-weight:600}
details{margin-top:12px}summary{cursor:pointer;font-size:16px;font-weight:600;padding:3px 0}summary span{font-weight:400;color:var(--soft);font-size:14px;margin-left:8px}
svg{width:100%;height:auto;display:block}.grid{stroke:var(--line);stroke-width:1}.axis{stroke:var(--soft);fill:none}.tick{fill:var(--soft);font-size:10.5px}.name{fill:var(--soft);font-size:11px}
.line{fill:none;stroke-width:1.6;stroke-linejoin:round}.all{stroke:var(--ink);stroke-width:2.2}
${[0, 1, 2, 3, 4, 5, 6, 7].map((i) => `.c${i}{stroke:var(--c${i})}.f${i}{fill:var(--c${i})}.k${i}{background:var(--c${i})}`).join('')}
.key{font-size:12px;color:var(--soft)}.key i{display:inline-block;width:10px;height:10px;border-radius:2px;margin:0 4px 0 10px}.k{background:var(--ink)}
`;

/** What else the machine did meanwhile, where that is known and not next to nothing. */
export function busy(runs) {
  const others = Math.max(0, ...runs.map(({ otherCores }) => otherCores ?? 0));
  return others > 0.2 ? `other processes took up to ${others.toFixed(1)} cores` : '';
}

/** @param report what load.json holds */
export function page(report) {
  const { about, machine, began, runs, table, complete } = report;
  const where = [about && `${about.name} ${about.version}, ${about.backend} (${about.device ?? about.simd ?? ''})`,
    `${machine.cpu}, ${machine.cores} cores, ${machine.memoryGiB} GiB`, began.replace('T', ' ').slice(0, 16) + ' UTC',
    busy(runs)].filter(Boolean);
  return `<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>Tomocast under load</title>
<style>${STYLE}</style><h1>Tomocast under load</h1><p class="soft">${where.map(escape).join(' · ')}</p>
${complete ? '' : '<p class="bad">Interrupted: what was measured until then.</p>'}
${table.length ? attacks(table, runs) : ramp(runs)}
<h2>Each measurement</h2>${runs.map((run, i) => details(run, i === 0 || runs.length <= 4)).join('\n')}
<h2>What the numbers are</h2>${NOTES}</html>`;
}

const NOTES = `<p><b>Motion to frame</b>: from sending a patch to the arrival of the first frame whose header says that patch or a later one. Patches
are sent at fixed times; one that no frame showed counts with its age (“unanswered”). <b>Stages</b> are the daemon's own, from the frames' headers.
<b>/healthz</b> is asked twenty times a second on new connections: its waits stand for how late the daemon's loop runs, with the tool's own lateness on
top. <b>Jain's index</b> is over milliseconds rendered for each client: 1 is even. <b>Peak memory</b> is of the daemon's process while it was measured.</p>`;

const rows = (head, body) => `<div class="card scroll"><table><thead><tr>${head.map((cell) => `<th>${cell}</th>`).join('')}</tr></thead><tbody>${body
  .map((cells) => `<tr>${cells.map((cell) => `<td>${cell}</td>`).join('')}</tr>`).join('')}</tbody></table></div>`;

function ramp(runs) {
  const head = ['clients', 'frames/s<br>a client', 'frames/s', 'Mbit/s', 'motion to frame<br>p50, ms', '<br>p95', '<br>p99', '<br>max', 'unanswered', 'CPU,<br>cores', 'peak<br>MiB', 'Jain', 'errors'];
  return `<h2>What so many clients get</h2>${rows(head, runs.map((run) => [
    escape(run.name), show(run.framesPerSecondPerClient, 1), show(run.framesPerSecond, 1), show((run.bytesPerSecond * 8) / 1e6, 1), show(run.latencyMs.p50),
    show(run.latencyMs.p95), show(run.latencyMs.p99), show(run.latencyMs.max), run.unanswered, show(run.cpuCores, 2), show(run.peakMiB), show(run.jain.renderMs, 3), errorsOf(run),
  ]))}`;
}

const errorsOf = ({ errors }) => escape(Object.entries(errors).map(([kind, count]) => `${count} × ${kind}`).join(', ') || 'none');

function attacks(table, runs) {
  const head = ['four ordinary clients beside', 'p50, ms', 'p99', 'max', 'p99 over<br>ordinary p99', 'un-<br>answered', '/healthz<br>p99, ms', '<br>max', 'loop lag<br>p99, ms', '<br>max', 'of it CPU<br>p99, ms', '<br>max', 'peak<br>MiB', 'Jain', 'SIGTERM,<br>s'];
  const grade = (value, good) => (value === null || value === undefined ? '–' : `<span class="${good ? 'good' : 'bad'}">${show(value, 2)}</span>`);
  const plain = runs.filter(({ bad }) => !bad || bad === 'ordinary').map((run) => [escape(run.name), ...numbers(run), '–', run.unanswered, show(run.healthMs.p99, 1),
    show(run.healthMs.max, 1), ...turns(run), show(run.peakMiB), show(run.jain.renderMs, 3), '–']);
  const attacked = table.map((row) => [`${escape(row.name)}<small>${escape(row.says)}</small>`, ...numbers(row), grade(row.ratio, row.ratio <= GOAL), row.unanswered,
    show(row.healthMs.p99, 1), show(row.healthMs.max, 1), ...turns(row), show(row.peakMiB), show(row.jainRenderMs, 3), ending(row.ended)]);
  return `<h2>Bad clients</h2><p class="soft">The goal: p99 at most ${GOAL} times what one more ordinary client makes it.</p>${rows(head, [...plain, ...attacked])}`;
}

const turns = ({ loopLagMs, loopCpuMs }) => [loopLagMs, loopCpuMs].flatMap((ms) => [show(ms?.p99, 1), show(ms?.max, 1)]);
const numbers = ({ latencyMs: { p50, p99, max } }) => [show(p50), show(p99), show(max)];
const ending = (ended) => (ended?.died ? '<span class="bad">died</span>' : ended ? (ended.killed ? `<span class="bad">killed after ${show(ended.seconds)}</span>` : show(ended.seconds, 1)) : '–');

function details(run, open) {
  const fact = (value, name) => `<div><b>${value}</b><span>${name}</span></div>`;
  return `<details class="card"${open ? ' open' : ''}><summary>${escape(run.name)}<span>${run.clients} client${run.clients > 1 ? 's' : ''}, ${show(run.seconds, 1)} s, ` +
    `p99 ${show(run.latencyMs.p99)} ms</span></summary><div class="facts">
${fact(show(run.framesPerSecondPerClient, 1), 'frames/s a client')}${fact(`${show(run.latencyMs.p50)} ms`, 'motion to frame, median')}${fact(`${show(run.latencyMs.p99)} ms`, 'p99')}
${fact(show(run.jain.renderMs, 3), "Jain's index")}${fact(show(run.cpuCores, 2), 'cores in use')}${fact(`${show(run.peakMiB)} MiB`, 'peak memory')}
${fact(`${show(run.streamPingMs.p99, 1)} ms`, 'stream ping, p99')}${fact(`${show(run.toolLagMs, 1)} ms`, "the tool's own lag, p99")}${fact(Object.values(run.errors).reduce((a, b) => a + b, 0), 'errors')}</div>
<div class="plots">${plots(run).map(([title, plot]) => `<div><h3>${title}</h3>${plot}</div>`).join('')}</div>${badFacts(run)}</details>`;
}

function badFacts({ badClient, rest, errors }) {
  const counts = badClient && Object.entries(badClient.counts).map(([kind, count]) => `${count} × ${kind}`).join(', ');
  const calls = rest && Object.entries(rest).map(([name, { count, p50, p99 }]) => `${name} ${count} × (${show(p50, 1)} / ${show(p99, 1)} ms)`).join(', ');
  return (badClient ? `<p class="soft">The other client counted: ${escape(counts || 'nothing')}${badClient.trouble ? `; ${escape(badClient.trouble)}` : ''}</p>` : '') +
    (calls ? `<p class="soft">REST calls, p50 / p99: ${escape(calls)}</p>` : '') + (Object.keys(errors).length ? `<p class="bad">Errors: ${errorsOf({ errors })}</p>` : '');
}

function plots(run) {
  const { timeline, perClient, stagesMs } = run;
  const shown = perClient.slice(0, MOST_LINES);
  const more = perClient.length > MOST_LINES ? `, the first ${MOST_LINES}` : '';
  const seconds = (list, ms) => list.map((value, i) => [((i + 0.5) * ms) / 1000, value]);
  const process = timeline.process.map(([at, cpu, memory]) => [at / 1000, cpu, memory]);
  const cores = process.slice(1).map(([at, cpu], i) => [at, (cpu - process[i][1]) / (at - process[i][0])]).filter((_, i) => process[i + 1][0] - process[i][0] > 0.05);
  const stages = Object.entries(stagesMs).map(([name, { p50, p95, p99 }]) => ({ name, values: [p50, p95, p99] }));
  const key = (names) => `<div class="key">${names.map(([name, colour]) => `<i class="${colour}"></i>${name}`).join('')}</div>`;
  return [
    [`Motion to frame, greatest in each quarter second, a line a client${more}`, linePlot(shown.map(({ line }, i) => ({ name: `client ${i + 1}`, points: seconds(line, timeline.binMs) })),
      { title: 'motion to frame over time', xLabel: 'seconds', yLabel: 'ms' })],
    ['Share of patches answered within', linePlot([...shown.map(({ latencyCdf }, i) => ({ name: `client ${i + 1}`, points: latencyCdf })), { name: 'all', points: run.latencyCdf, className: 'all' }],
      { title: 'distribution of motion to frame', xLabel: 'ms (logarithmic)', yLabel: 'share', xLog: true, yFrom: 0, yTo: 1 }) + key([['all clients', 'k']])],
    ["Stages of a frame", barPlot(stages, ['p50', 'p95', 'p99'], { title: 'stages', yLabel: 'ms' }) + key([['p50', 'k0'], ['p95', 'k1'], ['p99', 'k2']])],
    ['/healthz, greatest in each quarter second', linePlot([{ name: '/healthz', points: seconds(timeline.health, timeline.binMs) }], { title: 'healthz over time', xLabel: 'seconds', yLabel: 'ms' })],
    ['Resident memory of the daemon', linePlot([{ name: 'memory', points: process.map(([at, , memory]) => [at, memory]), className: 'c2' }], { title: 'memory over time', xLabel: 'seconds', yLabel: 'MiB' })],
    ['Processor time of the daemon', linePlot([{ name: 'cores', points: cores, className: 'c3' }], { title: 'processor over time', xLabel: 'seconds', yLabel: 'cores' })],
  ];
}
