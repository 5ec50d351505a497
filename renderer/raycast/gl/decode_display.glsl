// Compositing runs in display space: a grey stays as it is.
float decode(float grey) {
  return grey;
}
