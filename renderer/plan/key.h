/* The key of a plan: the part of a plan that selects the kernel or shader variant. */
#ifndef TC_PLAN_KEY_H
#define TC_PLAN_KEY_H

#include <stddef.h>
#include <stdint.h>

/* Labels (classify/labels.h) that samples look up: none, those of a label volume, or the volume's own gaps
 * (tc_volume_gaps), which are transparent. */
enum tc_plan_labels { TC_PLAN_NO_LABELS, TC_PLAN_LABELS, TC_PLAN_GAPS };

/* Kernels are specialised on these members: plans with equal keys run the same code. Zeroed before filling: compare
 * with memcmp. */
typedef struct tc_plan_key {
  uint8_t mode;           /* tc_mode */
  uint8_t voxel_type;     /* tc_voxel_type of the sampled field; B-spline coefficients are f32 */
  uint8_t classification; /* tc_classification */
  uint8_t order;          /* tc_compositing_order */
  uint8_t filter;         /* tc_filter */
  uint8_t projection;     /* tc_projection */
  uint8_t shading;        /* tc_shading_model */
  uint8_t gradient;       /* tc_gradient; 0 unless shaded */
  uint8_t termination;    /* 0/1 */
  uint8_t skipping;       /* 0/1 */
  uint8_t clipping;       /* 0/1 */
  uint8_t rays;           /* 0/1: several rays per pixel */
  uint8_t coherence;      /* 0/1 */
  uint8_t jitter;         /* 0/1 */
  uint8_t labels;         /* tc_plan_labels */
  uint8_t subtables;      /* 0/1: the pre-integration table has subtables (classify/preintegration.h) */
  uint8_t stiff;          /* 0/1: a ray's short last segment needs the table's row of depths (classify/preintegration.h) */
  uint8_t slab;           /* mpr: 0 one slice, else 1 + tc_slab_projection */
} tc_plan_key;

/* The key that draws the same picture without empty-space skipping. */
tc_plan_key tc_plan_unskipped(tc_plan_key key);

/* Name of a key's variant, such as "dvr.preintegrated.linear.shaded.u16"; back ends append their suffix. */
void tc_plan_key_name(const tc_plan_key *key, char *name, size_t size);

#endif
