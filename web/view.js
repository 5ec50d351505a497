// Frames onto the canvas: decodes only the newest, draws on display frames, acknowledges after drawing.

export class View {
  #canvas;
  #context;
  #on;
  #newest = null; // {frame, covers} waiting to be decoded
  #decoding = false;
  #ready = null; // {header, bytes, bitmap, covers} waiting for the next display frame
  #epoch = 0; // a decode started before forget() is dropped when it ends

  /** onDraw({header, bytes}) when a frame is on the canvas; onAck(frame number); onError(Error) */
  constructor(canvas, on) {
    this.#canvas = canvas;
    this.#context = canvas.getContext('2d', { alpha: false });
    this.#on = on;
  }

  /** @param {{header: object, image: Uint8Array, type: string}} frame */
  receive(frame) {
    this.#newest = { frame, covers: numbersOf(this.#newest?.covers, this.#newest?.frame.header) };
    if (!this.#decoding) this.#decode();
  }

  /** Drops frames not yet drawn; the picture stays. For a new connection, whose frame numbers start again. */
  forget() {
    this.#epoch += 1;
    this.#newest = null;
    this.#ready?.bitmap.close();
    this.#ready = null;
  }

  clear() {
    this.forget();
    this.#context.fillRect(0, 0, this.#canvas.width, this.#canvas.height);
  }

  async #decode() {
    const { frame, covers } = this.#newest;
    const epoch = this.#epoch;
    this.#newest = null;
    this.#decoding = true;
    const bitmap = await createImageBitmap(new Blob([frame.image], { type: frame.type })).catch(() => null);
    this.#decoding = false;
    if (epoch !== this.#epoch) bitmap?.close();
    else if (bitmap) this.#show(frame, bitmap, covers);
    else this.#broken(numbersOf(covers, frame.header));
    if (this.#newest) this.#decode();
  }

  #broken(numbers) {
    this.#confirm(numbers);
    this.#on.onError(new Error('a frame could not be decoded'));
  }

  #show({ header, image }, bitmap, covers) {
    const before = this.#ready;
    before?.bitmap.close(); // bitmaps hold graphics memory until closed
    const all = [...numbersOf(before?.covers, before?.header), ...covers];
    this.#ready = { header, bytes: image.length, bitmap, covers: all };
    if (!before) requestAnimationFrame(() => this.#draw());
  }

  #draw() {
    if (!this.#ready) return; // forgotten meanwhile
    const { header, bytes, bitmap, covers } = this.#ready;
    this.#ready = null;
    this.#resize(header);
    this.#context.imageSmoothingQuality = 'high';
    this.#context.fillRect(0, 0, this.#canvas.width, this.#canvas.height);
    this.#context.drawImage(bitmap, 0, 0, this.#canvas.width, this.#canvas.height);
    bitmap.close();
    this.#confirm(numbersOf(covers, header));
    this.#on.onDraw({ header, bytes });
  }

  // A frame of lower resolution is stretched over the same canvas: resizing a canvas clears it, and the picture must
  // not jump during a rotation.
  #resize({ width, height, final }) {
    const same = Math.abs(this.#canvas.width / this.#canvas.height - width / height) < 0.02;
    if (same && !final && width <= this.#canvas.width) return;
    if (this.#canvas.width !== width || this.#canvas.height !== height) {
      this.#canvas.width = width;
      this.#canvas.height = height;
    }
  }

  #confirm(numbers) {
    for (const number of numbers) this.#on.onAck(number);
  }
}

/** Numbers of the frames that were dropped and of the one that replaced them, acknowledged together. */
const numbersOf = (covers = [], header = undefined) => (header ? [...covers, header.frame] : [...covers]);

/**
 * Picture size for a stage of cssWidth x cssHeight.
 * @returns {{width: number, height: number}} device pixels, at most maxPixels in all, aspect kept
 */
export function pictureSize(cssWidth, cssHeight, pixelRatio, maxPixels) {
  const width = Math.max(1, cssWidth * pixelRatio);
  const height = Math.max(1, cssHeight * pixelRatio);
  const shrink = Math.min(1, Math.sqrt(maxPixels / (width * height)));
  return { width: Math.max(16, Math.floor(width * shrink)), height: Math.max(16, Math.floor(height * shrink)) };
}
