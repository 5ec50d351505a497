// Lengths for display: millimetres, micrometres for small ones, three digits of the whole.

const inMicrometres = (mm) => mm < 1;
const decimals = (extent) => Math.max(0, 2 - Math.floor(Math.log10(extent || 1) + 1e-9));

/** "17 mm", "0.35 mm", "128 \u00b5m": a part of an object `extent` mm long */
export function lengthText(mm, extent = mm) {
  const small = inMicrometres(extent);
  return `${(small ? mm * 1000 : mm).toFixed(decimals(small ? extent * 1000 : extent))} ${small ? '\u00b5m' : 'mm'}`;
}

/** "0.9 \u00d7 0.9 \u00d7 1.25 mm", or "12.8 \u00d7 12.8 \u00d7 12.8 \u00b5m" if all are below `least` mm */
export function lengthsText(lengths, { digits = 3, least = 0.1 } = {}) {
  const small = lengths.every((mm) => mm < least);
  const texts = lengths.map((mm) => Number((small ? mm * 1000 : mm).toPrecision(digits)));
  return `${texts.join(' \u00d7 ')} ${small ? '\u00b5m' : 'mm'}`;
}

/** A coordinate in mm, with the digits for a volume `extent` mm wide */
export const placeText = (mm, extent) => mm.toFixed(Math.max(1, decimals(extent)));
