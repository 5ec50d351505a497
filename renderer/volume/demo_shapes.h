/* Soft-edged shapes for demo volumes, painted in order, later ones over earlier ones. mm in LPS, centred at the
 * origin. */
#ifndef TC_VOLUME_DEMO_SHAPES_H
#define TC_VOLUME_DEMO_SHAPES_H

typedef enum tc_shape_kind { TC_ELLIPSOID, TC_CAPSULE } tc_shape_kind;

typedef struct tc_shape {
  tc_shape_kind kind;
  float a[3], b[3]; /* ellipsoid: centre and radii; capsule: its two ends */
  float ra, rb;     /* capsule: radii at the ends */
  float value;      /* painted value */
  float edge;       /* mm over which it fades */
  float wave;       /* folds the surface: amplitude in mm, 0 = smooth */
} tc_shape;

/* Paints the shape into slice z of a grid of cubic voxels: blends slice[y * dims[0] + x] towards value by the
 * shape's coverage. */
void tc_shape_paint(const tc_shape *shape, const int dims[3], const double origin[3], double spacing, int z,
                    float *slice);

/* Lists of shapes; the caller frees them with free(). */
tc_shape *tc_shapes_head(int *count);
tc_shape *tc_shapes_vessels(int *count);

#endif
