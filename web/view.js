// Frames onto the canvas: decodes only the newest, draws on the display's beat, confirms after drawing.

export class View {
  #canvas;
  #context;
  #on;
  #newest = null; // not yet being decoded
  #decoding = false;
  #ready = null; // decoded, waits for the next beat
  #superseded = []; // numbers of frames that will never be drawn; confirmed with the one that replaced them

  /** onDraw({header, bytes}) after a frame is on the canvas; onAck(frame number); onError(Error) */
  constructor(canvas, on) {
    this.#canvas = canvas;
    this.#context = canvas.getContext('2d', { alpha: false });
    this.#on = on;
  }

  /** @param {{header: object, image: Uint8Array, type: string}} frame */
  receive(frame) {
    if (this.#newest) this.#superseded.push(this.#newest.header.frame);
    this.#newest = frame;
    if (!this.#decoding) this.#decode();
  }

  /** Forgets what has not been drawn; the picture stays. For a new connection, whose frame numbers start again. */
  forget() {
    this.#newest = null;
    this.#superseded.length = 0;
    this.#ready?.bitmap.close();
    this.#ready = null;
  }

  clear() {
    this.forget();
    this.#context.fillRect(0, 0, this.#canvas.width, this.#canvas.height);
  }

  async #decode() {
    const frame = this.#newest;
    this.#newest = null;
    this.#decoding = true;
    try {
      const bitmap = await createImageBitmap(new Blob([frame.image], { type: frame.type }));
      this.#show(frame, bitmap);
    } catch (cause) {
      this.#superseded.push(frame.header.frame);
      this.#confirm();
      this.#on.onError(new Error('a frame could not be decoded', { cause }));
    }
    this.#decoding = false;
    if (this.#newest) this.#decode();
  }

  #show(frame, bitmap) {
    const waiting = this.#ready !== null;
    if (waiting) {
      this.#superseded.push(this.#ready.header.frame);
      this.#ready.bitmap.close(); // bitmaps hold graphics memory until closed
    }
    this.#ready = { header: frame.header, bytes: frame.image.length, bitmap };
    if (!waiting) requestAnimationFrame(() => this.#draw());
  }

  #draw() {
    if (!this.#ready) return; // forgotten meanwhile
    const { header, bytes, bitmap } = this.#ready;
    this.#ready = null;
    this.#resize(header);
    this.#context.imageSmoothingQuality = 'high';
    this.#context.fillRect(0, 0, this.#canvas.width, this.#canvas.height);
    this.#context.drawImage(bitmap, 0, 0, this.#canvas.width, this.#canvas.height);
    bitmap.close();
    this.#superseded.push(header.frame);
    this.#confirm();
    this.#on.onDraw({ header, bytes });
  }

  // A frame of lower resolution is stretched over the same canvas: changing a canvas's size clears it, and the picture
  // must not jump while it is turned.
  #resize({ width, height, final }) {
    const same = Math.abs(this.#canvas.width / this.#canvas.height - width / height) < 0.02;
    if (same && !final && width <= this.#canvas.width) return;
    if (this.#canvas.width !== width || this.#canvas.height !== height) {
      this.#canvas.width = width;
      this.#canvas.height = height;
    }
  }

  #confirm() {
    for (const number of this.#superseded.splice(0)) this.#on.onAck(number);
  }
}

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
