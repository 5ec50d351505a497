/* One renderer of each kind that this machine has, for the tests that ask all of them the same: the instruction sets of
 * the cpu back end and OpenGL. A test program hands test_renderers_open and test_renderers_close to cmocka. */
#ifndef TC_TEST_RENDERERS_H
#define TC_TEST_RENDERERS_H

#include "renderer/tomocast.h"

enum { SCALAR, AVX2, AVX512, GL, RENDERERS };
extern const char *const test_names[RENDERERS];
extern tc_renderer *test_renderers[RENDERERS]; /* NULL: not on this machine, which was printed */
extern tc_frame test_frames[RENDERERS];         /* the last picture of each */

#define EACH_RENDERER(i) for (int i = 0; i < RENDERERS; i++) if (test_renderers[i])
#define EACH_CPU(i) for (int i = 0; i < GL; i++) if (test_renderers[i])

int test_renderers_open(void **state); /* fails without the scalar one */
int test_renderers_close(void **state);

int test_widest(void); /* the widest instruction set that is here */

/* Draws, or fails the test. The frame stays valid until this renderer's next picture. request NULL: linear only. */
tc_frame *test_draw(int which, tc_volume *volume, const tc_scene *scene, const tc_render_request *request,
                    tc_explanation *plan);

/* Draws in pauses, each as soon as the back end looks, and fails the test unless what comes is test_draw()'s picture and
 * not another back end's. Returns how many pauses there were. */
int test_resumes(int which, tc_volume *volume, const tc_scene *scene);

/* The reference integrator's picture [4 * width * height] of the scene at a tolerance (0: the tightest); g_free it. */
float *test_reference(tc_volume *volume, const tc_scene *scene, double tolerance);

#endif
