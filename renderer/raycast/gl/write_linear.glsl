layout(std430, binding = 2) writeonly buffer Linear { vec4 linear[]; }; // [h][w] premultiplied colour, opacity

void write_result(uint at, vec4 premultiplied) {
  picture[at] = resolve(premultiplied);
  linear[at] = premultiplied;
}
