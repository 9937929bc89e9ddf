/* Exact steps in C, for bench/kernel.c: sim/exact.py, function by function. */
#include "kernel_physics.h"

static void factors(const Plant *p, State *s, double h, double *even, double *odd, double *area) {
  if (p->omega_n != s->kept_omega_n || p->zeta != s->kept_zeta) {
    s->kept_omega_n = p->omega_n, s->kept_zeta = p->zeta;
    s->kept_h = s->spare_h = 0.0;
  }
  if (fabs(h - s->kept_h) > SAME * h) {
    if (fabs(h - s->spare_h) <= SAME * h) {
      *even = s->spare_even, *odd = s->spare_odd, *area = s->spare_area;
      return;
    }
    const double square = p->omega_n * p->omega_n, damping = p->zeta * p->omega_n;
    s->spare_h = s->kept_h, s->spare_even = s->kept_even, s->spare_odd = s->kept_odd, s->spare_area = s->kept_area;
    s->kept_h = h;
    s->kept_even = oscillation(damping, square, h, &s->kept_odd);
    s->kept_area = (1.0 - s->kept_even - damping * s->kept_odd) / square;
  }
  *even = s->kept_even, *odd = s->kept_odd, *area = s->kept_area;
}

static void exact_step(const Plant *p, State *s, const double *z, double h, double *out) {
  const double square = p->omega_n * p->omega_n, damping = p->zeta * p->omega_n, lag = p->valve_lag_time;
  double flows = 0.0, fading = 0.0, rate = 0.0, gone = 0.0;
  for (int i = 0; i < STATES; i++) out[i] = z[i];
  if (lag == 0.0) {
    flows = p->K_L * opening(p, s->target);
  } else {
    const double off = s->spool - s->target, halfway = exp(-0.5 * h / lag), middle = s->target + off * halfway;
    const double fades = opens(p, middle) * off;
    flows = p->K_L * (opening(p, middle) - fades * halfway), fading = p->K_L * fades;
    rate = 1.0 / lag, gone = halfway * halfway;
  }
  if (s->motion == 0.0 || s->stopped != 0.0) {
    const double settles = -expm1(-2.0 * damping * h);
    out[PRESSURE] += (square * flows / (2.0 * damping) - z[PRESSURE]) * settles;
    if (fading != 0.0) out[PRESSURE] += square * fading * (gone - 1.0 + settles) / (2.0 * damping - rate);
    return;
  }
  double push = drive(p, s, s->t, 0.0, z[POSITION], 0.0) - s->motion * friction_level(p, z[VELOCITY]);
  double ends = flows + 2.0 * damping * push / square, swept = ends * h;
  double off = z[VELOCITY] - ends, pull = z[PRESSURE] + push, even, odd, area;
  if (fading != 0.0) {
    const double lags = square * fading / (rate * (rate - 2.0 * damping) + square);
    off -= lags, pull += rate * lags;
    ends += lags * gone, swept += lags * (1.0 - gone) / rate;
    push += rate * lags * gone;
  }
  factors(p, s, h, &even, &odd, &area);
  out[PRESSURE] = (even - damping * odd) * pull - square * odd * off - push;
  out[VELOCITY] = ends + (even + damping * odd) * off + odd * pull;
  const double goes = swept + (odd + 2.0 * damping * area) * off + area * pull;
  out[POSITION] += goes, out[POSITION2] += goes;
  out[VELOCITY2] += out[VELOCITY] - z[VELOCITY];
}
