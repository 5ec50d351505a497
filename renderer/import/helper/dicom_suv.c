#include "renderer/import/helper/dicom_suv.h"

#include <glib.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>

/* Days since 1970-01-01 of a date of the Gregorian calendar. */
static long days(int year, int month, int day) {
  const int shifted = month > 2 ? year : year - 1, turn = (month + 9) % 12; /* years start in March here */
  return 365l * shifted + shifted / 4 - shifted / 100 + shifted / 400 + (153 * turn + 2) / 5 + day - 719469;
}

/* Converts "YYYYMMDD" and "HHMM[SS[.F]]" to seconds; false if either is malformed. */
static bool seconds(const char *date, const char *time, double *out) {
  int year, month, day, hour, minute, used = 0;
  double second = 0;
  if (strspn(date, "0123456789") < 8 || strspn(time, "0123456789") < 4) return false;
  if (sscanf(date, "%4d%2d%2d", &year, &month, &day) != 3 || sscanf(time, "%2d%2d%n", &hour, &minute, &used) != 2) return false;
  if (g_ascii_isdigit(time[used])) second = g_ascii_strtod(time + used, NULL);
  if (month < 1 || month > 12 || hour > 23 || minute > 59 || !(second >= 0 && second < 61)) return false;
  *out = 86400.0 * (double)days(year, month, day) + hour * 3600 + minute * 60 + second;
  return true;
}

static bool both(const char *text, double *out) { return strlen(text) >= 12 && seconds(text, text + 8, out); }

/* Start of the scan: the series' time, unless a later processing changed it. */
static bool scan_start(const tc_dicom_suv *s, double *scan) {
  double acquired;
  if (both(s->scan, scan)) return true;
  if (!seconds(s->series_date, s->series_time, scan)) return false;
  return !seconds(s->acquisition_date, s->acquisition_time, &acquired) || *scan <= acquired;
}

/* Seconds from the injection to the start of the scan. A time without a date is the last such time before the scan. */
static bool decay_time(const tc_dicom_suv *s, double *decay) {
  double scan, start;
  if (!scan_start(s, &scan)) return false;
  if (both(s->start, &start)) {
    *decay = scan - start;
  } else {
    if (!seconds("19700101", s->start_time, &start)) return false;
    *decay = fmod(scan - start, 86400);
  }
  return *decay >= 0 && *decay < 7 * 86400.0;
}

static double refuse(const char **missing, const char *what) {
  *missing = what;
  return 0;
}

double tc_dicom_suv_factor(const tc_dicom_suv *s, const char **missing) {
  double decay = 0;
  *missing = "";
  if (strcmp(s->units, "GML") == 0) return 1; /* values are SUV already */
  if (strcmp(s->units, "CNTS") == 0 && s->philips > 0) return s->philips;
  if (strcmp(s->units, "BQML") != 0) return refuse(missing, "units are not Bq/ml");
  if (!strstr(s->corrected, "ATTN") || !strstr(s->corrected, "DECY"))
    return refuse(missing, "not corrected for attenuation and decay");
  if (!(s->weight_kg > 0) || !(s->dose_bq > 0)) return refuse(missing, "weight or dose are not given");
  const bool at_injection = strcmp(s->decay, "ADMIN") == 0;
  if (!at_injection && strcmp(s->decay, "START") != 0) return refuse(missing, "decay is corrected to no known time");
  if (!at_injection && (!(s->half_life_s > 0) || !decay_time(s, &decay)))
    return refuse(missing, "half-life or times are not given or contradict each other");
  const double factor = s->weight_kg * 1000 / (s->dose_bq * exp2(-decay / fmax(s->half_life_s, 1)));
  return isfinite(factor) ? factor : refuse(missing, "dose or times are absurd");
}
