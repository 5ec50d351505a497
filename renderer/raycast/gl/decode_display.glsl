// Compositing in display space: a grey needs no conversion.
float decode(float grey) {
  return grey;
}
