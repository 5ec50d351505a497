// The scene as this client holds it, and what the daemon has not been told yet.

const isObject = (value) => value !== null && typeof value === 'object' && !Array.isArray(value);

/** RFC 7396 merge patch; gives a new value, shares what did not change. */
export function mergePatch(target, patch) {
  if (!isObject(patch)) return patch;
  const merged = isObject(target) ? { ...target } : {};
  for (const [name, value] of Object.entries(patch)) {
    if (value === null) delete merged[name];
    else merged[name] = mergePatch(merged[name], value);
  }
  return merged;
}

/** Joins two patches into one with the effect of `first`, then `second`. A null stays: it still has to be sent. */
export function joinPatches(first, second) {
  if (!isObject(first) || !isObject(second)) return second;
  const joined = { ...first };
  for (const [name, value] of Object.entries(second)) {
    joined[name] = name in joined ? joinPatches(joined[name], value) : value;
  }
  return joined;
}

/** The scene this client shows. Edits are applied at once and collected; take() hands them over as one patch. */
export class SceneStore {
  scene = null;
  #pending = null;
  #listeners = new Set();

  /** fn(scene, how): how is "edit" (ours), "history" (of an edit, there or back), "fit" (no step of undo) or "server" */
  subscribe(fn) {
    this.#listeners.add(fn);
    return () => this.#listeners.delete(fn);
  }

  /** The daemon's word on the scene. Patches still on their way, and edits not yet sent, stay on top of it. */
  replace(scene, flying = []) {
    const above = this.#pending ? [...flying, this.#pending] : flying;
    this.scene = above.reduce(mergePatch, scene);
    this.#tell('server');
  }

  /** An edit. Before the daemon has given a scene there is nothing to edit. */
  patch(patch, how = 'edit') {
    if (!this.scene) return;
    this.scene = mergePatch(this.scene, patch);
    this.#pending = this.#pending ? joinPatches(this.#pending, patch) : patch;
    this.#tell(how);
  }

  get dirty() {
    return this.#pending !== null;
  }

  /** @returns {object|null} everything edited since the last call, as one merge patch */
  take() {
    const pending = this.#pending;
    this.#pending = null;
    return pending;
  }

  /** Puts back a patch that was taken but may not have arrived; later edits win over it. The scene has it already. */
  requeue(patch) {
    this.#pending = this.#pending ? joinPatches(patch, this.#pending) : patch;
  }

  #tell(how) {
    for (const fn of [...this.#listeners]) fn(this.scene, how);
  }
}
