/* The published tables this renderer's methods come from, measured anew on the volumes at hand. */
#ifndef TC_SERVER_BENCH_PAPERS_H
#define TC_SERVER_BENCH_PAPERS_H

#include <cjson/cJSON.h>

#include "renderer/tomocast.h"

typedef struct tcs_paper_run {
  const char
      *paper;     /* "000": classification, order and sub-pixel coherence; "001": termination, leaping, block sizes */
  int size, runs; /* side of the picture, frames per cell */
  int threads;
  bool gl;    /* measure the gl back end too */
  bool print; /* as text, to stdout */
} tcs_paper_run;

bool tcs_paper_known(const char *paper);

/* The head of the paper's tables with the rows it published, to stdout and, as {"paper", "published"}, into report. */
void tcs_paper_begin(const tcs_paper_run *run, cJSON *report);

/* One volume's rows, printed and added to report as {"paper", "volume", "dims", "type", "backend", "cells": [{"table",
 * "name", "framesPerSecond", "ms", "why"}]}; what cannot be rendered is "-" (null) with its reason. Frames of all cells
 * take turns. The scene gives camera, transfer function and the rest. */
bool tcs_paper_volume(const tcs_paper_run *run, tc_volume *volume, const char *name, const tc_scene *scene,
                      cJSON *report, GError **error);

#endif
