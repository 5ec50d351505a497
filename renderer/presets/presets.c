/* Presets of transfer functions and windows.
 *
 * The ct-* and mr-* families have the Hounsfield (or raw MR) values that radiology viewers share, so that a picture
 * looks as its reader expects; opacity is per 1 mm. Their separate colour and opacity lists are merged into one: every
 * value of either list is a knot, the other list is interpolated linearly. Published opacities that are meant for a
 * maximum projection or for shading are lower here (ct-soft-tissue, and the unit distance of the translucent presets),
 * so that the unlit picture shows depth. Relative presets have knot values 0..1 of the volume's range and serve volumes
 * of unknown modality. */
#include "renderer/presets/fit.h"

#include <string.h>

#include <glib.h>

static const tc_knot ct_bone[] = {{-16.4458, {0.729412, 0.254902, 0.301961}, 0},
                                  {641.385, {0.905882, 0.815686, 0.552941}, 0.715686},
                                  {3071, {1, 1, 1}, 0.705882}};
static const tc_knot ct_aaa[] = {{143.556, {0.615686, 0.356863, 0.184314}, 0},
                                 {166.222, {0.882353, 0.603922, 0.290196}, 0.686275},
                                 {214.389, {1, 1, 1}, 0.696078},
                                 {419.736, {1, 0.937033, 0.954531}, 0.833333},
                                 {3071, {0.827451, 0.658824, 1}, 0.803922}};
static const tc_knot ct_soft_tissue[] = {{-167.01, {0.0556356, 0.0556356, 0.0556356}, 0},
                                         {-160, {0.0556356, 0.0556356, 0.0556356}, 0.03},
                                         {40, {0.527818, 0.527818, 0.527818}, 0.1},
                                         {240, {1, 1, 1}, 0.6},
                                         {3661, {1, 1, 1}, 0.8}};
static const tc_knot ct_lung[] = {{-1000, {0.3, 0.3, 1}, 0},
                                  {-600, {0, 0, 1}, 0},
                                  {-599, {0.00192434, 0.0111675, 0.986749}, 0.15},
                                  {-530, {0.134704, 0.781726, 0.0724558}, 0.15},
                                  {-460, {0.929244, 1, 0.109473}, 0.15},
                                  {-400, {0.888889, 0.254949, 0.0240258}, 0.15},
                                  {-399, {0.888922, 0.254962, 0.0241081}, 0},
                                  {2952, {1, 0.3, 0.3}, 0}};
static const tc_knot ct_mip[] = {{-637.62, {1, 1, 1}, 0}, {700, {1, 1, 1}, 1}, {3071, {1, 1, 1}, 1}};
static const tc_knot ct_cardiac[] = {
    {-86.9767, {0, 0.25098, 1}, 0},       {45.3791, {1, 0, 0}, 0.169643}, {139.919, {1, 0.894893, 0.894893}, 0.589286},
    {347.907, {1, 1, 0.25098}, 0.607143}, {1224.16, {1, 1, 1}, 0.607143}, {3071, {0.827451, 0.658824, 1}, 0.616071}};
static const tc_knot ct_chest_contrast[] = {{67.0106, {0.54902, 0.25098, 0.14902}, 0},
                                            {251.105, {0.882353, 0.603922, 0.290196}, 0.446429},
                                            {439.291, {1, 0.937033, 0.954531}, 0.625},
                                            {3071, {0.827451, 0.658824, 1}, 0.616071}};
static const tc_knot ct_muscle[] = {{-155.407, {0.54902, 0.25098, 0.14902}, 0},
                                    {217.641, {0.882353, 0.603922, 0.290196}, 0.676471},
                                    {419.736, {1, 0.937033, 0.954531}, 0.833333},
                                    {3071, {0.827451, 0.658824, 1}, 0.803922}};
static const tc_knot ct_fat[] = {{-1000, {0.3, 0.3, 1}, 0},
                                 {-497.5, {0, 0, 1}, 0},
                                 {-100, {0, 0, 1}, 0},
                                 {-99, {0, 0, 1}, 0.15},
                                 {-76.946, {0, 1, 0}, 0.15},
                                 {-65.481, {0.835431, 0.888889, 0.0165387}, 0.15},
                                 {-60, {0.84147, 0.856272, 0.0159318}, 0.15},
                                 {-59, {0.842571, 0.850321, 0.0158211}, 0},
                                 {83.89, {1, 0, 0}, 0},
                                 {101.2, {1, 0, 0}, 0},
                                 {463.28, {1, 0, 0}, 0},
                                 {659.15, {1, 0.912535, 0.0374849}, 0},
                                 {952, {1, 0.834334, 0.0709996}, 0},
                                 {2952, {1, 0.300267, 0.299886}, 0}};
/* Designed for scans whose threshold between air and tissue is about 115; relative, because receivers differ. */
static const tc_knot mr_default[] = {{0.06, {0.168627, 0, 0}, 0},
                                     {0.12, {0.403922, 0.145098, 0.0784314}, 0.15},
                                     {0.36, {0.780392, 0.607843, 0.380392}, 0.3},
                                     {0.5, {0.847059, 0.835294, 0.788235}, 0.375},
                                     {1, {1, 1, 1}, 0.5}};
static const tc_knot mr_angio[] = {{151.354, {0, 0, 0}, 0},
                                   {158.279, {0.74902, 0.376471, 0}, 0.4375},
                                   {190.112, {1, 0.866667, 0.733333}, 0.580357},
                                   {200.873, {0.937255, 0.937255, 0.937255}, 0.732143},
                                   {3661, {1, 1, 1}, 0.741071}};
static const tc_knot mr_mip[] = {{98.3725, {1, 1, 1}, 0}, {416.637, {1, 1, 1}, 1}, {2800, {1, 1, 1}, 1}};
static const tc_knot mr_t2_brain[] = {{36.05, {0.349414, 0.306453, 0.0701691}, 0},
                                      {98.7223, {0.956863, 0.839216, 0.192157}, 0.0589505},
                                      {218.302, {0.592096, 0.745034, 0.426863}, 0.171429},
                                      {412.406, {0, 0.592157, 0.807843}, 1},
                                      {641, {1, 1, 1}, 1}};
static const tc_knot ct_head[] = {{-400, {0.86, 0.6, 0.48}, 0},   {-200, {0.882857, 0.634286, 0.514286}, 0.02},
                                  {-50, {0.9, 0.66, 0.54}, 0.05}, {90, {0.8, 0.45, 0.38}, 0.05},
                                  {160, {0.85, 0.6, 0.48}, 0.02}, {250, {0.93, 0.84, 0.68}, 0.35},
                                  {500, {0.98, 0.95, 0.88}, 0.8}, {3071, {1, 1, 1}, 0.9}};
static const tc_knot ct_vessels[] = {{120, {0.35, 0.05, 0.04}, 0},   {180, {0.66, 0.12, 0.08}, 0.25},
                                     {300, {0.86, 0.28, 0.17}, 0.7}, {450, {0.95, 0.62, 0.42}, 0.7375},
                                     {700, {0.97, 0.93, 0.85}, 0.8}, {3071, {1, 1, 1}, 0.85}};
static const tc_knot grey_ramp[] = {{0, {0, 0, 0}, 0}, {0.05, {0.05, 0.05, 0.05}, 0}, {1, {1, 1, 1}, 0.4}};
static const tc_knot soft_fog[] = {{0, {0.25, 0.35, 0.55}, 0},
                                   {0.1, {0.35, 0.44, 0.61}, 0},
                                   {0.4, {0.65, 0.71, 0.79}, 0.02},
                                   {0.5, {0.75, 0.8, 0.85}, 0.0366667},
                                   {1, {1, 0.97, 0.92}, 0.12}};
static const tc_knot surface[] = {{0, {0.45, 0.22, 0.16}, 0},       {0.15, {0.55, 0.28, 0.2}, 0},
                                  {0.3, {0.8, 0.55, 0.42}, 0.12},   {0.5, {0.92, 0.806, 0.676}, 0.6},
                                  {0.55, {0.95, 0.87, 0.74}, 0.63}, {1, {1, 1, 0.97}, 0.9}};
static const tc_knot vessels[] = {{0, {0.3, 0.04, 0.04}, 0},         {0.35, {0.45, 0.06, 0.05}, 0},
                                  {0.5, {0.696, 0.18, 0.116}, 0.3},  {0.6, {0.86, 0.26, 0.16}, 0.55},
                                  {0.7, {0.895, 0.42, 0.3075}, 0.8}, {1, {1, 0.9, 0.75}, 0.9}};
static const tc_knot spectrum[] = {{0, {0.05, 0.1, 0.6}, 0},      {0.1, {0.03, 0.3, 0.72}, 0},
                                   {0.25, {0, 0.6, 0.9}, 0.0375}, {0.3, {0.02, 0.64, 0.78}, 0.05},
                                   {0.5, {0.1, 0.8, 0.3}, 0.15},  {0.75, {0.95, 0.85, 0.1}, 0.275},
                                   {1, {0.9, 0.1, 0.1}, 0.4}};

#define KNOTS(name) TC_KNOT_OPACITY, 1.0, name, G_N_ELEMENTS(name)

static const tc_preset presets[] = {
    {"ct-bone", "CT bone", "CT", KNOTS(ct_bone), false, true},
    {"ct-head", "CT head: skin and skull", "CT", KNOTS(ct_head), false, true},
    {"ct-soft-tissue", "CT soft tissue", "CT", KNOTS(ct_soft_tissue), false, true},
    {"ct-muscle", "CT muscle and bone", "CT", KNOTS(ct_muscle), false, true},
    {"ct-fat", "CT fat", "CT", KNOTS(ct_fat), false, true},
    {"ct-lung", "CT lung", "CT", KNOTS(ct_lung), false, true},
    {"ct-aaa", "CT abdominal aorta", "CT", KNOTS(ct_aaa), false, true},
    {"ct-cardiac", "CT cardiac", "CT", KNOTS(ct_cardiac), false, true},
    {"ct-chest-contrast", "CT chest, contrast enhanced", "CT", KNOTS(ct_chest_contrast), false, true},
    {"ct-vessels", "CT angiography: vessels", "CT", KNOTS(ct_vessels), false, true},
    {"ct-mip", "CT translucent", "CT", TC_KNOT_OPACITY, 250.0, ct_mip, G_N_ELEMENTS(ct_mip), false, false},
    {"mr-default", "MR", "MR", KNOTS(mr_default), true, false},
    {"mr-angio", "MR angiography", "MR", KNOTS(mr_angio), false, false},
    {"mr-t2-brain", "MR T2 brain", "MR", KNOTS(mr_t2_brain), false, false},
    {"mr-mip", "MR translucent", "MR", TC_KNOT_OPACITY, 20.0, mr_mip, G_N_ELEMENTS(mr_mip), false, false},
    {"grey-ramp", "Grey ramp", "", KNOTS(grey_ramp), true, false},
    {"soft-fog", "Soft fog", "", KNOTS(soft_fog), true, false},
    {"surface", "Surface", "", KNOTS(surface), true, true},
    {"vessels", "Bright vessels", "", KNOTS(vessels), true, false},
    {"spectrum", "Spectrum", "", KNOTS(spectrum), true, false},
};

static const tc_window_preset windows[] = {
    {"ct-soft-tissue", "Soft tissue", "CT", 40, 400},
    {"ct-brain", "Brain", "CT", 40, 80},
    {"ct-lung", "Lung", "CT", -600, 1500},
    {"ct-bone", "Bone", "CT", 480, 2500},
    {"ct-liver", "Liver", "CT", 90, 150},
    {"ct-mediastinum", "Mediastinum", "CT", 80, 400},
    {"ct-angio", "Angiography", "CT", 300, 600},
    {"pt-default", "PET, SUV 0 to 5", "PT", 2.5, 5},
};

const tc_preset *tc_presets(size_t *count) {
  *count = G_N_ELEMENTS(presets);
  return presets;
}

const tc_window_preset *tc_window_presets(size_t *count) {
  *count = G_N_ELEMENTS(windows);
  return windows;
}

const tc_window_preset *tc_window_preset_named(const char *name) {
  for (size_t i = 0; i < G_N_ELEMENTS(windows); i++)
    if (strcmp(windows[i].name, name) == 0) return &windows[i];
  return NULL;
}
