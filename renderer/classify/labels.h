/* Labels: the colours of a segmentation's voxels, and their positions in another volume's index space.
 *
 * A label volume holds integers (any integer voxel type; label = slope * voxel + intercept) on a grid of its own,
 * anywhere in the same patient space. 0, a negative number and anything outside the grid mean "no label". At a point,
 * the eight surrounding voxels count with their trilinear weights: the entries of the labels (tc_labels below) are
 * interpolated, not the numbers, so the faces of a segment are smooth at any zoom. Beyond the last voxel centres the
 * weight passes to "outside" within one voxel; an axis of one voxel is constant over its thickness. With filter
 * "nearest", only the nearest voxel counts.
 *   S, A, V = interpolated tint colour (premultiplied), tint opacity and visibility
 *   dvr: extinction * V; colour C becomes C (1 - A/V) + S/V   (a hidden label does not tint its neighbours)
 *   mpr: grey G becomes G (1 - A) + S                          (anatomy is never hidden)
 *   mesh: colour S/A of a surface; splat: of each voxel of the labels that are visible
 * A volume's own gaps (tc_volume_gaps) are labels that only hide. Without a label volume they are met in dvr as above; a
 * sample of a slice or a projection counts where V >= 0.5. */
#ifndef TC_CLASSIFY_LABELS_H
#define TC_CLASSIFY_LABELS_H

#include "renderer/base/error.h"
#include "renderer/base/halt.h"
#include "renderer/scene/scene.h"
#include "renderer/volume/volume.h"

typedef struct tc_labels {
  uint64_t serial;     /* unique in the process */
  int base, n;         /* entries of the stored voxels base .. base + n - 1; entry n stands for outside */
  float (*entries)[8]; /* [n + 1]: S r, g, b, A, V, unused */
  GBytes *key;         /* tc_labels_key() */
  size_t bytes;
  double build_ms;
} tc_labels;

/* A scene that shows a volume's gaps (tc_volume_gaps): they hide, and nothing is tinted. */
const tc_scene *tc_labels_of_gaps(void);
/* Whether the scene draws a volume's own colours (tc_volume_colors): in slices of no thickness, without other labels. */
bool tc_labels_in_color(const tc_volume *volume, const tc_scene *scene);
/* A scene that shows them. */
const tc_scene *tc_labels_of_colors(void);

/* Everything that entries depend on: label volume, opacity, colours, visible labels, compositing space. The caller
 * unrefs. */
GBytes *tc_labels_key(const tc_volume *labels, const tc_scene *scene);

/* Takes ownership of `key`. The label volume was checked (tc_labels_check). NULL with TC_ERROR_MEMORY or the error
 * of the halt (NULL: none). */
tc_labels *tc_labels_build(const tc_volume *labels, const tc_scene *scene, GBytes *key, const tc_halt *halt,
                           GError **error);
void tc_labels_free(tc_labels *labels); /* NULL is fine */

/* From index positions of `volume` to those of `labels`: rows of 3 factors and an offset. */
void tc_labels_matrix(const tc_volume *volume, const tc_volume *labels, double matrix[3][4]);

/* Whether scenes of this mode read labels; others ignore scene.labels. */
bool tc_mode_has_labels(tc_mode mode);

/* Whether the scene's labels can be drawn from `labels` (NULL: there is no such volume) over `volume`; true for a
 * scene without labels. TC_ERROR_INVALID with the pointer /labels/volume if there is no volume, its labels are not
 * integers (f32 voxels, or a fractional slope or intercept), or the two volumes lie apart in patient space. Pure. */
bool tc_labels_check(const tc_volume *volume, const tc_volume *labels, const tc_scene *scene, GError **error);

/* Whether scene->labels.visible has the label. */
bool tc_labels_show(const tc_scene *scene, uint32_t label);

#endif
