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

static double damped(const Plant *p, double *leaks, double *rubs) {
  const double damping = 2.0 * p->zeta * p->omega_n;
  *rubs = p->viscous_friction_share * damping, *leaks = damping - *rubs;
  return p->omega_n * p->omega_n + *leaks * *rubs;
}

static Factors factors(const Plant *p, State *s, double h) {
  double leaks, rubs;
  const double square = damped(p, &leaks, &rubs);
  if (square != s->kept_square || leaks + rubs != s->kept_damping) {
    s->kept_square = square, s->kept_damping = leaks + rubs;
    s->kept_h = s->spare_h = 0.0;
  }
  if (fabs(h - s->kept_h) > SAME * h) {
    if (fabs(h - s->spare_h) <= SAME * h) return (Factors){s->spare_answer, s->spare_area, s->spare_volume};
    const Factors f = made(square, 0.5 * (leaks + rubs), h);
    s->spare_h = s->kept_h, s->spare_answer = s->kept_answer;
    s->spare_area = s->kept_area, s->spare_volume = s->kept_volume;
    s->kept_h = h, s->kept_answer = f.answer, s->kept_area = f.area, s->kept_volume = f.volume;
  }
  return (Factors){s->kept_answer, s->kept_area, s->kept_volume};
}

static bool on_one_side(const Plant *p, const State *s) {
  const double edge = p->valve_deadband_half_width;
  if (p->static_valve_map_at_ports != 0.0) return false;
  if (edge == 0.0 && p->asymmetric_gain_ratio == 0.0) return true;
  const double low = min(s->spool, s->target) - p->null_shift_voltage;
  const double high = max(s->spool, s->target) - p->null_shift_voltage;
  return low >= edge || high <= -edge || (low >= -edge && high <= edge);
}

static bool linear_now(const Plant *p, const State *s, double velocity) {
  if (p->linear != 0.0) return true;
  if (s->motion * velocity < PASSED * p->stribeck_friction_speed && p->stribeck_friction_level > 0.0) return false;
  if (p->lugre_friction_stiffness > 0.0 && !settled(p, s)) return false;
  if (p->valve_lag_time > 0.0) return on_one_side(p, s);
  return p->valve_rate_limit_rate == INFINITY || s->spool == s->target;
}

/* Pressure and speed now, and what h adds to pressure, speed and position. */
static void swing(const Plant *p, const State *s, double h, double *out) {
  const double w = p->periodic_disturbance_omega, amplitude = p->periodic_disturbance_amplitude;
  double leaks, rubs;
  const double square = damped(p, &leaks, &rubs), below = square - w * w, lost = (leaks + rubs) * w;
  const double each = amplitude / (below * below + lost * lost);
  const double along = each * (leaks * below + w * lost), ahead = each * (w * below - leaks * lost);
  const double half = 0.5 * w * h, middle = w * (s->t - s->origin) + p->periodic_disturbance_phase + half;
  const double sine = sin(middle), cosine = cos(middle), odd = sin(half), even = cos(half);
  const double begins = sine * even - cosine * odd, level = cosine * even + sine * odd;
  const double rises = 2.0 * odd * cosine, falls = -2.0 * odd * sine;
  const double pushed = rubs * along - w * ahead - amplitude, held = rubs * ahead + w * along;
  out[0] = pushed * begins + held * level, out[1] = along * begins + ahead * level;
  out[2] = pushed * rises + held * falls, out[3] = along * rises + ahead * falls;
  out[4] = (ahead * rises - along * falls) / w;
}

/* Adds the same of a flow that fades to `flows`. */
static void fade(const Plant *p, const State *s, double flows, double h, double *out) {
  double leaks, rubs;
  const double square = damped(p, &leaks, &rubs), rate = 1.0 / p->valve_lag_time;
  const double excess = p->K_L * opening(p, s->spool) - flows;
  const double velocity = p->omega_n * p->omega_n * excess / (rate * (rate - leaks - rubs) + square);
  const double faster = velocity * expm1(-rate * h);
  out[0] += (rubs - rate) * velocity, out[1] += velocity;
  out[2] += (rubs - rate) * faster, out[3] += faster, out[4] -= p->valve_lag_time * faster;
}

static void exact_step(const Plant *p, State *s, const double *z, double h, double *out) {
  const double flows = p->K_L * opening(p, s->target);
  double leaks, rubs;
  const double square = damped(p, &leaks, &rubs);
  for (int i = 0; i < STATES; i++) out[i] = z[i];
  if (s->motion == 0.0 || s->stopped != 0.0) {
    const double rises = p->omega_n * p->omega_n * flows - leaks * z[PRESSURE];
    out[PRESSURE] += rises * (leaks > 0.0 ? -expm1(-leaks * h) / leaks : h);
    return;
  }
  const double push = steady_drive(p, s, s->t, 0.0, z[POSITION]) - s->motion * friction_level(p, z[VELOCITY]);
  double driven[5] = {0.0, 0.0, 0.0, 0.0, 0.0};
  if (p->periodic_disturbance_amplitude != 0.0) swing(p, s, h, driven);
  if (p->valve_lag_time > 0.0) fade(p, s, flows, h, driven);
  const double apart = z[VELOCITY] - driven[1], pull = z[PRESSURE] - driven[0] + push - rubs * apart;
  const double off = square * apart - p->omega_n * p->omega_n * flows - leaks * push;
  const Factors f = factors(p, s, h);
  const double faster = f.answer * pull - f.area * off;
  const double goes = apart * h + f.area * pull - f.volume * off + driven[4];
  out[PRESSURE] += driven[2] - (square * f.area + (leaks + rubs) * f.answer) * pull - f.answer * off + rubs * faster;
  out[VELOCITY] += faster + driven[3], out[VELOCITY2] += faster + driven[3];
  out[POSITION] += goes, out[POSITION2] += goes;
}
