// Results as Markdown and as lines for a terminal.

const show = (value, digits = 0) => (value === null || value === undefined ? '–' : typeof value === 'number' ? value.toFixed(digits) : String(value));
const each = (list) => list.map((value) => show(value)).join(', ');
const lines = (head, rows) => [head, head.map(() => '---'), ...rows].map((cells) => `| ${cells.join(' | ')} |`).join('\n');

export function runLine(run) {
  const { latencyMs: l, healthMs: h } = run;
  const errors = Object.entries(run.errors).map(([kind, count]) => `${kind}: ${count}`).join(', ');
  return `${run.name.padEnd(20)} ${show(run.framesPerSecondPerClient, 1)} frames/s a client; motion to frame ${show(l.p50)} / ${show(l.p99)} / ` +
    `${show(l.max)} ms (p50/p99/max); healthz p99 ${show(h.p99, 1)} ms; ${show(run.peakMiB)} MiB; Jain ${show(run.jain.renderMs, 3)}` +
    `${run.stolenMs ? `; ${run.stolenMs} ms of the processors taken by the hypervisor` : ''}${run.unanswered ? `; ${run.unanswered} unanswered` : ''}${errors ? `; ${errors}` : ''}${run.complete ? '' : ' (cut short)'}`;
}

/** What so many clients get. */
export function rampTable(runs) {
  const head = ['clients', 'frames/s a client', 'motion to frame p50, ms', 'p99, ms', 'server CPU, cores', 'peak memory, MiB', 'Jain index'];
  return lines(head, runs.map((run) => [
    run.clients, show(run.framesPerSecondPerClient, 1), show(run.latencyMs.p50), show(run.latencyMs.p99), show(run.cpuCores, 2),
    show(run.peakMiB), show(run.jain.renderMs, 3),
  ]));
}

/** What four ordinary clients get beside each bad one. */
export function badTable(table) {
  const head = ['beside', 'p50, ms', 'p99, ms', 'max, ms', 'p99 / ordinary p99', 'p99 of each run', 'of each ordinary one', 'unanswered', '/healthz p99, ms', 'max, ms',
    'loop lag p99, ms', 'max, ms', 'of it CPU p99, ms', 'max, ms', 'peak, MiB', 'Jain', 'ends in, s'];
  return lines(head, table.map((row) => [
    row.name, show(row.latencyMs.p50), show(row.latencyMs.p99), show(row.latencyMs.max), show(row.ratio, 2), each(row.eachP99.row), each(row.eachP99.ordinary), row.unanswered,
    show(row.healthMs.p99, 1), show(row.healthMs.max, 1), show(row.loopLagMs?.p99, 1), show(row.loopLagMs?.max, 1), show(row.loopCpuMs?.p99, 1), show(row.loopCpuMs?.max, 1), show(row.peakMiB),
    show(row.jainRenderMs, 3), row.ended ? `${show(row.ended.seconds, 1)}${row.ended.killed ? ' (killed)' : row.ended.died ? ' (died)' : ''}` : '–',
  ]));
}
