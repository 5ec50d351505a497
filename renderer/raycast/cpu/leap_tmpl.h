/* Leaping over what shows nothing (skip/skip.h). Part of the template. */

/* Looks around the packet at mm t. *steps: how many whole steps every live ray may go on and stay in the cube of blocks that is
 * known of it. True when all those cubes are empty, so that the steps may be leapt; false when a ray is in a block with
 * something in it, and looking again makes no sense for that many steps. The margin of a hundredth of a voxel is far above the
 * rounding of positions (skip/skip.h). */
V_INLINE bool look_around(const tc_cpu_args *g, const packet *p, vf t, vm live, int *steps) {
  vf q[3], block[3];
  for (int k = 0; k < 3; k++) {
    q[k] = v_min(v_max(v_fma(t, p->dir[k], p->entry[k]), v_set(0)), v_set(g->last[k]));
    vf cell = v_float(v_mini(v_trunc(q[k]), v_seti(g->cell_last[k])));
    block[k] = v_float(v_trunc((cell + v_set(0.5f)) * v_set(g->inverse_block))); /* the half keeps rounding away from edges */
  }
  vi off = v_addi(v_muli(v_trunc(block[2]), v_seti(g->block_slice)), v_muli(v_trunc(block[1]), v_seti(g->block_row)));
  off = v_addi(off, v_trunc(block[0]));
  vf distance = v_float(v_bytes(g->distance, off));
  vm full = m_and(live, v_lt(distance, v_set(1)));
  vf reach = (v_max(distance, v_set(1)) - v_set(1)) * v_set(g->block), far = v_set(1e9f);
  for (int k = 0; k < 3; k++) {
    vf corner = block[k] * v_set(g->block);
    vm ahead = v_lt(v_set(0), p->dir[k]);
    vf wall = v_select(ahead, corner + reach + v_set(g->block - 0.01f), corner - reach + v_set(0.01f));
    vf mm = (wall - q[k]) * p->inverse[k];
    far = v_min(far, v_select(v_lt(v_abs(p->dir[k]), v_set(1e-12f)), v_set(1e9f), mm));
  }
  float least = v_least(v_select(live, far, v_set(1e9f))) * g->inverse_step;
  *steps = least < 1 ? 0 : least < 1e6f ? (int)least : 1000000;
  return !m_any(full);
}

/* All live rays' segments lie in a stretch of values at either end of the axis that shows nothing. */
V_INLINE bool all_zero(const tc_cpu_args *g, vf front, vf back, vm live) {
  vm below = m_and(v_lt(front, v_set(g->zero_below)), v_lt(back, v_set(g->zero_below)));
  vm above = m_and(v_lt(v_set(g->zero_above), front), v_lt(v_set(g->zero_above), back));
  return !m_any(m_andnot(live, m_or(below, above)));
}
