void write_result(uint at, vec4 premultiplied) {
  picture[at] = resolve(premultiplied);
}
