/* The field with filters nearest and cubic. */

/* Voxels added to positions before the nearest voxel is chosen. Pixels often lie exactly halfway between two voxels: all of them
 * then show the upper voxel, whatever the rounding error of their positions. */
#define NEAREST_UP 0.001f

/* The nearest voxel at t mm along the rays. It is a corner of the cell around the position, so bounds on a cell's corners hold
 * for it. */
V_INLINE vf sample_nearest(const tc_cpu_args *args, variant v, const packet *p, vf t) {
  vi at[3];
  for (int k = 0; k < 3; k++) {
    vf q = v_min(v_max(v_fma(t, p->dir[k], p->entry[k]), v_set(0)), v_set(args->grid.last[k]));
    at[k] = v_trunc(q + v_set(0.5f + NEAREST_UP));
  }
  vf voxel, neighbour;
  vi off = v_addi(at[0], v_addi(v_muli(at[1], v_seti(args->grid.row)), v_muli(at[2], v_seti(args->grid.slice))));
  fetch_pair(v.type, args->grid.voxels, off, &voxel, &neighbour);
  return voxel;
}

V_INLINE vf sample_filtered(const tc_cpu_args *args, variant v, const packet *p, vf t) {
  return v.filter == TC_FILTER_CUBIC ? sample_cubic(args, v, p, t, NULL) : sample_nearest(args, v, p, t);
}
