// The scene of this client, and its edits that the daemon does not have yet.

const isObject = (value) => value !== null && typeof value === 'object' && !Array.isArray(value);

/** RFC 7396 merge patch; returns a new value that shares unchanged parts. */
export function mergePatch(target, patch) {
  if (!isObject(patch)) return patch;
  const merged = isObject(target) ? { ...target } : {};
  for (const [name, value] of Object.entries(patch)) {
    if (value === null) delete merged[name];
    else merged[name] = mergePatch(merged[name], value);
  }
  return merged;
}

/** Joins two patches into one with the effect of `first`, then `second`. Keeps nulls, which must still be sent. */
export function joinPatches(first, second) {
  if (!isObject(first) || !isObject(second)) return second;
  const joined = { ...first };
  for (const [name, value] of Object.entries(second)) {
    joined[name] = name in joined ? joinPatches(joined[name], value) : value;
  }
  return joined;
}

/** The scene this client shows. Edits apply immediately and are collected; take() returns them as one patch. */
export class SceneStore {
  scene = null;
  #pending = null;
  #listeners = new Set();

  /** fn(scene, how): how is "edit" (ours), "history" (undo or redo), "fit" (not undoable) or "server" */
  subscribe(fn) {
    this.#listeners.add(fn);
    return () => this.#listeners.delete(fn);
  }

  /** Sets the daemon's scene. Patches in flight and edits not yet sent stay on top. */
  replace(scene, flying = []) {
    const above = this.#pending ? [...flying, this.#pending] : flying;
    this.scene = above.reduce(mergePatch, scene);
    this.#tell('server');
  }

  /** Applies an edit; ignored before the daemon has sent a scene. */
  patch(patch, how = 'edit') {
    if (!this.scene) return;
    this.scene = mergePatch(this.scene, patch);
    this.#pending = this.#pending ? joinPatches(this.#pending, patch) : patch;
    this.#tell(how);
  }

  get dirty() {
    return this.#pending !== null;
  }

  /** @returns {object|null} all edits since the last call, as one merge patch */
  take() {
    const pending = this.#pending;
    this.#pending = null;
    return pending;
  }

  /**
   * Puts back a patch that was taken but perhaps not received; later edits take precedence. The scene already has it.
   */
  requeue(patch) {
    this.#pending = this.#pending ? joinPatches(patch, this.#pending) : patch;
  }

  #tell(how) {
    for (const fn of [...this.#listeners]) fn(this.scene, how);
  }
}
