/* Jitter: each pixel's phase is shifted by interleaved gradient noise, in the integers of raycast/jitter.h. */

V_INLINE vf add_jitter(const place *at, vf phase) {
  vi x = v_addi(v_seti(at->x), v_trunc(v_lane_x())), y = v_addi(v_seti(at->y), v_trunc(v_lane_y()));
  vi inner = v_addi(v_muli(x, v_seti((int)TC_JITTER_X)), v_muli(y, v_seti((int)TC_JITTER_Y)));
  vi high = v_andi(v_sra(inner, 16), v_seti(0xffff));
  vi noise = v_subi(v_muli(inner, v_seti((int)TC_JITTER_TIMES)), v_muli(high, v_seti((int)TC_JITTER_LESS)));
  noise = v_addi(v_andi(v_sra(noise, 8), v_seti(0xffffff)), v_seti(1));
  phase = phase + v_float(noise) * v_set(0x1p-24f);
  return v_select(v_lt(v_set(1), phase), phase - v_set(1), phase);
}
