// Overlays of the picture: edge letters, orientation cube, scale bar. Reads the scene, changes only its own elements.

import { basis, dot, edgeLetters, roundLength, scale, sliceBasis, STANDARD_VIEWS } from './camera.js';
import { lengthsText } from './units.js';

const SVG = 'http://www.w3.org/2000/svg';
const CUBE_HALF = 17; // in a drawing of 100 units
const FACE_UP = { A: [0, 0, 1], P: [0, 0, 1], L: [0, 0, 1], R: [0, 0, 1], H: [0, -1, 0], F: [0, -1, 0] };

export function svg(name, attributes = {}, parent = null) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  parent?.append(element);
  return element;
}

/** The picture's axes in patient space, for every mode. */
export function pictureBasis(scene) {
  return scene.mode === 'mpr' ? sliceBasis(scene.mpr) : basis(scene.camera);
}

/**
 * The cube's faces as the camera sees them, farthest first. `matrix` maps a face drawn in [-1, 1]^2 (y down) to the
 * drawing; back faces have `facing` <= 0.
 */
export function cubeFaces({ right, up, direction }) {
  const flat = (v) => [dot(v, right) * CUBE_HALF, -dot(v, up) * CUBE_HALF];
  return Object.entries(STANDARD_VIEWS)
    .map(([letter, { from }]) => {
      const faceUp = FACE_UP[letter];
      // right of a face for a viewer outside: (-from) x up
      const faceRight = [
        from[2] * faceUp[1] - from[1] * faceUp[2],
        from[0] * faceUp[2] - from[2] * faceUp[0],
        from[1] * faceUp[0] - from[0] * faceUp[1],
      ];
      const [ax, ay] = flat(faceRight);
      const [bx, by] = flat(scale(faceUp, -1));
      const [cx, cy] = flat(from);
      return { letter, facing: -dot(from, direction), matrix: [ax, ay, bx, by, cx, cy] };
    })
    .sort((a, b) => a.facing - b.facing);
}

export class Furniture {
  #marks;
  #cube;
  #faces = new Map();
  #bar;
  #barLabel;

  /** elements: {top, bottom, left, right, cube, bar, barLabel}; onView(letter) when a face is clicked */
  constructor(elements, onView) {
    this.#marks = elements;
    this.#bar = elements.bar;
    this.#barLabel = elements.barLabel;
    this.#cube = svg('svg', { viewBox: '-34 -34 68 68', 'aria-hidden': 'true' });
    elements.cube.append(this.#cube);
    for (const letter of Object.keys(STANDARD_VIEWS)) {
      const group = svg('g', { class: 'face' }, this.#cube);
      svg('rect', { x: -1, y: -1, width: 2, height: 2 }, group);
      svg('text', { 'text-anchor': 'middle', y: 0.36 }, group).textContent = letter;
      svg('title', {}, group).textContent = `${STANDARD_VIEWS[letter].title} view`;
      group.addEventListener('click', () => onView(letter));
      this.#faces.set(letter, group);
    }
  }

  /** mmPerPixel: per CSS pixel, or 0 in perspective, which has no single scale. */
  update(scene, mmPerPixel) {
    const axes = pictureBasis(scene);
    for (const [edge, text] of Object.entries(edgeLetters(axes))) this.#marks[edge].textContent = text;
    for (const { letter, facing, matrix } of cubeFaces(axes)) {
      const group = this.#faces.get(letter);
      group.setAttribute('transform', `matrix(${matrix.map((x) => x.toFixed(3)).join(' ')})`);
      group.toggleAttribute('hidden', facing <= 0.02);
      group.setAttribute('class', `face${facing > 0.9 ? ' front' : ''}`);
      this.#cube.append(group); // drawn last, so on top
    }
    this.#scaleBar(mmPerPixel);
  }

  #scaleBar(mmPerPixel) {
    this.#bar.hidden = !mmPerPixel;
    if (!mmPerPixel) return;
    const mm = roundLength(mmPerPixel * 160);
    this.#bar.style.width = `${mm / mmPerPixel}px`;
    this.#barLabel.textContent = mm >= 10 ? `${mm / 10} cm` : lengthsText([mm], { least: 1 });
  }
}
