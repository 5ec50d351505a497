/* The transfer function at single values: extinction and colour, and the sRGB curve. */
#ifndef TC_CLASSIFY_TRANSFER_H
#define TC_CLASSIFY_TRANSFER_H

#include "renderer/scene/scene.h"

/* Extinction (1/mm) at a value, and its mean over [a, b] (exact per knot interval; a == b gives tau(a)). */
double tc_extinction(const tc_transfer_function *tf, double value);
double tc_extinction_mean(const tc_transfer_function *tf, double a, double b);
double tc_extinction_most(const tc_transfer_function *tf); /* largest extinction at any value */
/* Colour at a value, sRGB 0..1. */
void tc_color(const tc_transfer_function *tf, double value, double rgb[3]);

#define TC_LIGHT_STEPS 4096 /* steps of a table of the sRGB curve */
double tc_srgb_to_linear(double c);
double tc_linear_to_srgb(double c);

#endif
