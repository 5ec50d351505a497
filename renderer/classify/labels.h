/* Labels: what a segmentation's voxels look like, and where they are in another volume's index space.
 *
 * A label volume holds whole numbers (any integer voxel type; label = slope * voxel + intercept) on a grid of its own,
 * anywhere in the same patient space. 0 is "no label"; so is all that lies outside the grid, and a negative number.
 * At a point the eight voxels around it count with their trilinear weights: not their numbers are interpolated but what
 * the numbers stand for (tc_labels below), so that the faces of a segment are smooth at any zoom. Beyond the last voxel
 * centres the weights go over to "outside" within one voxel; an axis of one voxel is constant over its thickness. With
 * filter "nearest" the nearest voxel alone counts.
 *   S, A, V = means of entries' tint colour (premultiplied), tint opacity and visibility
 *   dvr: extinction * V; colour C becomes C (1 - A/V) + S/V   (what is hidden lends no colour to what is beside it)
 *   mpr: grey G becomes G (1 - A) + S                          (anatomy is never hidden); mesh: colour S/A of a surface */
#ifndef TC_CLASSIFY_LABELS_H
#define TC_CLASSIFY_LABELS_H

#include "renderer/error.h"
#include "renderer/halt.h"
#include "renderer/scene.h"
#include "renderer/volume/volume.h"

typedef struct tc_labels {
  uint64_t serial;     /* unique in the process */
  int base, n;         /* entries of the stored voxels base .. base + n - 1; entry n is what lies outside */
  float (*entries)[8]; /* [n + 1]: S r, g, b, A, V, unused */
  GBytes *key;         /* tc_labels_key() it was made for */
  size_t bytes;
  double build_ms;
} tc_labels;

/* What entries depend on: label volume, opacity, colours, visible ones, compositing space. Caller unrefs. */
GBytes *tc_labels_key(const tc_volume *labels, const tc_scene *scene);

/* Takes `key`. The label volume was checked (tc_labels_check). NULL: TC_ERROR_MEMORY, or what the halt (NULL: none)
 * says. */
tc_labels *tc_labels_build(const tc_volume *labels, const tc_scene *scene, GBytes *key, const tc_halt *halt,
                           GError **error);
void tc_labels_free(tc_labels *labels); /* NULL is fine */

/* Index positions of `labels` from those of `volume`: rows of 3 factors and an offset. */
void tc_labels_matrix(const tc_volume *volume, const tc_volume *labels, double matrix[3][4]);

/* Do scenes of this mode read labels? The others leave scene.labels alone: values and their extremes have no colour. */
bool tc_mode_has_labels(tc_mode mode);

/* Can the scene's labels be drawn from `labels` (NULL: there is no such volume) over `volume`? True for a scene without
 * any. TC_ERROR_INVALID with the pointer /labels/volume: there is none, its voxels are not whole numbers (f32, or a
 * slope or intercept with a fraction), or the two lie apart in patient space. Pure. */
bool tc_labels_check(const tc_volume *volume, const tc_volume *labels, const tc_scene *scene, GError **error);

#endif
