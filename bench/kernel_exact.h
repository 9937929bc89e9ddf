/* Exact steps in C, for bench/kernel.c: sim/exact.py, function by function. */
#include "kernel_physics.h"

typedef struct { double answer, area, volume; } Factors;

static Factors series(double square, double d, double h) {
  Factors f = {0.0, 0.0, 0.0};
  double before = 0.0, now = 1.0, power = h;
  for (int n = 1; n < TERMS; n++) {
    f.answer += now * power;
    f.area += now * power * h / (n + 1.0);
    f.volume += now * power * h * h / ((n + 1.0) * (n + 2.0));
    const double next = -2.0 * d * now - square * before;
    before = now, now = next;
    power *= h / (n + 1.0);
  }
  return f;
}

static Factors made(double square, double d, double h) {
  if (h * (2.0 * d + sqrt(square)) < SMALL) return series(square, d, h);
  double odd;
  const double even = oscillation(d, square, h, &odd), area = (1.0 - even - d * odd) / square;
  return (Factors){odd, area, (h - odd - 2.0 * d * area) / square};
}

static Factors factors(const Plant *p, State *s, double h) {
  if (p->omega_n != s->kept_omega_n || p->zeta != s->kept_zeta) {
    s->kept_omega_n = p->omega_n, s->kept_zeta = p->zeta;
    s->kept_h = s->spare_h = 0.0;
  }
  if (fabs(h - s->kept_h) > SAME * h) {
    if (fabs(h - s->spare_h) <= SAME * h) return (Factors){s->spare_answer, s->spare_area, s->spare_volume};
    const Factors f = made(p->omega_n * p->omega_n, p->zeta * p->omega_n, h);
    s->spare_h = s->kept_h, s->spare_answer = s->kept_answer;
    s->spare_area = s->kept_area, s->spare_volume = s->kept_volume;
    s->kept_h = h, s->kept_answer = f.answer, s->kept_area = f.area, s->kept_volume = f.volume;
  }
  return (Factors){s->kept_answer, s->kept_area, s->kept_volume};
}

static void exact_step(const Plant *p, State *s, const double *z, double h, double *out) {
  const double flows = p->K_L * opening(p, s->target);
  const double square = p->omega_n * p->omega_n, leaks = 2.0 * p->zeta * p->omega_n;
  for (int i = 0; i < STATES; i++) out[i] = z[i];
  if (s->motion == 0.0 || s->stopped != 0.0) {
    out[PRESSURE] += (square * flows / leaks - z[PRESSURE]) * -expm1(-leaks * h);
    return;
  }
  const double push = drive(p, s, s->t, 0.0, z[POSITION], 0.0) - s->motion * friction_level(p, z[VELOCITY]);
  const double pull = z[PRESSURE] + push, off = square * (z[VELOCITY] - flows) - leaks * push;
  const Factors f = factors(p, s, h);
  const double faster = f.answer * pull - f.area * off;
  const double goes = z[VELOCITY] * h + f.area * pull - f.volume * off;
  out[PRESSURE] -= (square * f.area + leaks * f.answer) * pull + f.answer * off;
  out[VELOCITY] += faster, out[VELOCITY2] += faster;
  out[POSITION] += goes, out[POSITION2] += goes;
}
