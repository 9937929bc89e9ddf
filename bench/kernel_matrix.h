/* Exact steps by a matrix in C, for bench/kernel.c: sim/matrix_steps.py, function by function. */
#include <string.h>
#include "kernel_exact.h"

typedef double Matrix[MATRIX_STATES][MATRIX_STATES];

static void matrix_rates(const Plant *p, const State *s, const double *z, double opened, double *d) {
  double leaks, rubs;
  damped(p, &leaks, &rubs);
  d[0] = p->omega_n * p->omega_n * (p->K_L * opened - z[VELOCITY]) - leaks * z[PRESSURE];
  double push = steady_drive(p, s, s->t, z[PRESSURE], z[POSITION]);
  push -= s->motion * friction_level(p, z[VELOCITY]) + rubs * z[VELOCITY];
  const double ratio = p->load_resonance_inertia;
  d[1] = d[3] = push;
  d[2] = d[4] = z[VELOCITY];
  if (ratio > 0.0) {
    d[3] = coupling(p, z[VELOCITY], z), d[4] = z[VELOCITY2];
    d[1] = (1.0 + ratio) * push - ratio * d[3];
  }
  d[5] = 0.0;
  if (p->sensor_lag_time > 0.0)
    d[5] = ((p->measures_speed != 0.0 ? z[VELOCITY] : z[POSITION]) - z[LAGGED]) / p->sensor_lag_time;
}

static void matrix_step(const Plant *p, const State *s, const double *z, double opened, int k, double *out) {
  static const int place[MATRIX_STATES] = {PRESSURE, VELOCITY, POSITION, VELOCITY2, POSITION2, LAGGED};
  double d[MATRIX_STATES];
  matrix_rates(p, s, z, opened, d);
  out[BRISTLE] = z[BRISTLE];
  for (int i = 0; i < MATRIX_STATES; i++) {
    double more = 0.0;
    for (int j = 0; j < MATRIX_STATES; j++) more += s->matrices[k][i][j] * d[j];
    out[place[i]] = z[place[i]] + more;
  }
}

static void product(Matrix a, Matrix b, double factor, Matrix out) {
  for (int i = 0; i < MATRIX_STATES; i++)
    for (int j = 0; j < MATRIX_STATES; j++) {
      double sum = 0.0;
      for (int k = 0; k < MATRIX_STATES; k++) sum += a[i][k] * b[k][j];
      out[i][j] = factor * sum;
    }
}

static void coefficients(const Plant *p, Matrix a) {
  double leaks, rubs;
  damped(p, &leaks, &rubs);
  const double ratio = p->load_resonance_inertia, omega = p->load_resonance_omega;
  a[0][0] = -leaks, a[0][1] = -p->omega_n * p->omega_n;
  a[1][0] = 1.0 + ratio, a[1][1] = -(1.0 + ratio) * rubs, a[1][2] = -(1.0 + ratio) * p->load_spring_stiffness;
  a[2][1] = 1.0;
  if (ratio > 0.0) {
    const double springs = omega * omega, damps = 2.0 * p->load_resonance_zeta * omega;
    a[3][1] = damps, a[3][2] = springs, a[3][3] = -damps, a[3][4] = -springs;
    a[4][3] = 1.0;
    for (int j = 1; j < 5; j++) a[1][j] -= ratio * a[3][j];
  } else {
    for (int j = 0; j < MATRIX_STATES; j++) a[3][j] = a[1][j];
    a[4][1] = 1.0;
  }
  if (p->sensor_lag_time > 0.0) {
    a[5][p->measures_speed != 0.0 ? 1 : 2] = 1.0 / p->sensor_lag_time;
    a[5][5] = -1.0 / p->sensor_lag_time;
  }
}

static void integral(const Plant *p, double h, Matrix m) {
  const int doublings = (int)max(0.0, ceil(log2(4.0 * h / p->substep)));
  const double part = h / pow(2.0, doublings);
  Matrix a = {{0.0}}, term = {{0.0}}, next;
  coefficients(p, a);
  for (int i = 0; i < MATRIX_STATES; i++) term[i][i] = part;
  memcpy(m, term, sizeof term);
  for (int n = 2; n <= MATRIX_TERMS; n++) {
    product(a, term, part / n, next);
    memcpy(term, next, sizeof term);
    for (int i = 0; i < MATRIX_STATES; i++)
      for (int j = 0; j < MATRIX_STATES; j++) m[i][j] += term[i][j];
  }
  for (int n = 0; n < doublings; n++) {
    product(a, m, 1.0, term);
    product(m, term, 1.0, next);
    for (int i = 0; i < MATRIX_STATES; i++)
      for (int j = 0; j < MATRIX_STATES; j++) m[i][j] += m[i][j] + next[i][j];
  }
}

static int another(const Plant *p, State *s, double h) {
  if (s->matrices_of != p->by_matrix) {
    s->matrices_of = p->by_matrix, s->owed = 0.0;
    for (int k = 0; k < KEPT; k++) s->lengths[k] = 0.0;
  }
  if (s->owed > (KEPT - 1.0) * WORTH) return -1;
  const int k = (int)s->oldest;
  s->oldest = (k + 1) % KEPT;
  s->lengths[k] = h;
  s->owed = max(s->owed, 0.0) + WORTH;
  integral(p, h, s->matrices[k]);
  return k;
}

static int kept(const Plant *p, State *s, double h) {
  if (s->matrices_of == p->by_matrix)
    for (int k = 0; k < KEPT; k++)
      if (fabs(h - s->lengths[k]) <= MATRIX_SAME * h) {
        s->owed -= 1.0;
        return k;
      }
  return another(p, s, h);
}
