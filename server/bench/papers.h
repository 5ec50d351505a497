/* Repeats the published tables of the methods that this renderer uses, on the given volumes. */
#ifndef TC_SERVER_BENCH_PAPERS_H
#define TC_SERVER_BENCH_PAPERS_H

#include <cjson/cJSON.h>

#include "renderer/tomocast.h"

typedef struct tcs_paper_run {
  const char *paper; /* "000": classification, order, sub-pixel coherence; "001": termination, skipping, block sizes */
  int size, runs; /* side of the picture, frames per cell */
  int threads;
  bool gl;    /* measure the gl back end too */
  bool print; /* as text, to stdout */
} tcs_paper_run;

bool tcs_paper_known(const char *paper);

/* Prints the header of the paper's tables with the published rows, and adds {"paper", "published"} to report. */
void tcs_paper_begin(const tcs_paper_run *run, cJSON *report);

/* Prints one volume's rows and adds {"paper", "volume", "dims", "type", "backend", "cells": [{"table", "name",
 * "framesPerSecond", "ms", "why"}]} to report. Cells that cannot be rendered are "-" (null) with the reason. The cells
 * take turns, frame by frame. The scene supplies camera, transfer function and the rest. */
bool tcs_paper_volume(const tcs_paper_run *run, tc_volume *volume, const char *name, const tc_scene *scene,
                      cJSON *report, GError **error);

#endif
