// Compositing in linear light: greys are display values, decoded by the inverse sRGB curve (IEC 61966-2-1).
float decode(float grey) {
  return grey <= 0.04045 ? grey / 12.92 : pow((grey + 0.055) / 1.055, 2.4);
}
