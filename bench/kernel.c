/* The kernel once more in C, to compare with: sim/kernel.py and sim/runs.py, function by function; the equations
 * (sim/physics.py) and the choice of substeps (sim/substep.py) are in headers of their own.
 *
 * bench/kernel_in_c.py writes kernel_records.h (the records Plant, State and Relay, all of doubles, and the
 * constants) from the tables of sim/ and compiles this by `cc -O2`. Names, units and reasons are in sim/.
 */
#include "kernel_substep.h"

/* Integration and events: sim/kernel.py */

static void command(const Plant *p, State *s, double volts) {
  volts = clip(volts, -p->valve_saturation_limit, p->valve_saturation_limit);
  if (p->static_valve_map_at_ports == 0.0) volts = mapped(p, volts);
  s->target = clip(s->target, volts - p->valve_hysteresis_half_width, volts + p->valve_hysteresis_half_width);
}

static void move_spool(const Plant *p, State *s, double h) {
  if (swings(p)) s->spool = swung(p, s, h, &s->spool_speed);
  else s->spool = spool_at(p, s, h);
}

static double measured(const Plant *p, const State *s) {
  return p->sensor_lag_time > 0.0 ? s->lagged : seen(p, s, s->position, s->velocity);
}

static double quantized(const Plant *p, double value) {
  const double step = p->sensor_quantization_step;
  return step == 0.0 ? value : step * floor(value / step + 0.5);
}

static void moved(const double *z, const double *k, double h, double *out) {
  for (int i = 0; i < STATES; i++) out[i] = z[i] + h * k[i];
}

static void step(const Plant *p, State *s, const double *z, double h, double *out) {
  if (p->linear != 0.0) {
    exact_step(p, s, z, h, out);
    return;
  }
  double a[STATES], b[STATES], c[STATES], d[STATES], at[STATES];
  const double half = 0.5 * h;
  const double middle = opening(p, spool_at(p, s, half));
  rates(p, s, z, s->t, opening(p, spool_moves(p) ? s->spool : s->target), a);
  moved(z, a, half, at);
  rates(p, s, at, s->t + half, middle, b);
  moved(z, b, half, at);
  rates(p, s, at, s->t + half, middle, c);
  moved(z, c, h, at);
  rates(p, s, at, s->t + h, opening(p, spool_at(p, s, h)), d);
  for (int i = 0; i < STATES; i++)
    out[i] = z[i] + h / 6.0 * a[i] + h / 3.0 * b[i] + h / 3.0 * c[i] + h / 6.0 * d[i];
}

static void accept(const Plant *p, State *s, const double *z, double h) {
  move_spool(p, s, h);
  s->t += h;
  s->pressure = z[PRESSURE], s->velocity = z[VELOCITY], s->position = z[POSITION];
  s->velocity2 = z[VELOCITY2], s->position2 = z[POSITION2], s->bristle = z[BRISTLE], s->lagged = z[LAGGED];
  s->followed = followed(p, s, s->position);
  s->steps += p->linear != 0.0 ? COST : 1.0;
}

static double balance(const Plant *p, const State *s, const double *z, double t) {
  return drive(p, s, t, z[PRESSURE], z[POSITION], p->load_resonance_inertia > 0.0 ? coupling(p, 0.0, z) : 0.0);
}

static double breaks_away(const Plant *p, const State *s, const double *z, double t) {
  const double drives = balance(p, s, z, t);
  const double holds = p->lugre_friction_stiffness == 0.0 ? friction_level(p, 0.0) : 0.0;
  return (s->stopped == 0.0 ? fabs(drives) : -s->stopped * drives) - holds;
}

static double event(const Plant *p, const State *s, const double *z, double h) {
  double most = -1.0;
  if (s->watch != 0.0) {
    const double sees = p->sensor_lag_time > 0.0 ? z[LAGGED] : seen(p, s, z[POSITION], z[VELOCITY]);
    most = max(most, s->watch * (sees - s->level - s->rate * (s->t + h)));
  }
  if (s->stopped != 0.0 || s->motion == 0.0) return max(most, breaks_away(p, s, z, s->t + h));
  if (dry_friction(p) || p->backlash_gap > 0.0 || p->lugre_friction_stiffness > 0.0)
    most = max(most, -s->motion * z[VELOCITY]);
  if (p->backlash_gap > 0.0 && p->sensor_lag_time > 0.0 && !in_contact(p, s))
    most = max(most, s->motion * (z[POSITION] - s->followed) - 0.5 * p->backlash_gap);
  return max(most, max(z[POSITION] - p->stop_high, p->stop_low - z[POSITION]));
}

static double locate(const Plant *p, State *s, const double *z, double h) {
  double low = 0.0, high = h, then[STATES];
  const double sharp = SHARPNESS * h;
  step(p, s, z, h, then);
  double at_low = event(p, s, z, 0.0), at_high = event(p, s, then, h);
  int side = 0;
  for (int trial = 0; trial < 4 * MOST_TRIALS && high - low > sharp; trial++) {
    double middle = 0.5 * (low + high);
    if (trial <= MOST_TRIALS && at_high > at_low)
      middle = clip((low * at_high - high * at_low) / (at_high - at_low), low + 0.5 * sharp, high - 0.5 * sharp);
    s->steps += p->linear != 0.0 ? COST : 1.0;
    step(p, s, z, middle, then);
    const double value = event(p, s, then, middle);
    if (value > 0.0) {
      high = middle, at_high = value;
      if (side > 0) at_low *= 0.5;
      side = 1;
    } else {
      low = middle, at_low = value;
      if (side < 0) at_high *= 0.5;
      side = -1;
    }
  }
  return high;
}

static void stop(const Plant *p, State *s) {
  s->stopped = s->position >= p->stop_high ? 1.0 : -1.0;
  s->position = s->stopped > 0.0 ? p->stop_high : p->stop_low;
  s->velocity = s->bristle = 0.0;
  s->followed = followed(p, s, s->position);
  if (p->load_resonance_inertia == 0.0) s->velocity2 = 0.0, s->position2 = s->position;
}

static void turn_round(const Plant *p, State *s, double *z) {
  if (!dry_friction(p)) {
    s->motion = -s->motion;
    return;
  }
  s->velocity = z[VELOCITY] = 0.0;
  if (p->load_resonance_inertia == 0.0) s->velocity2 = z[VELOCITY2] = 0.0;
  const double drives = balance(p, s, z, s->t);
  s->motion = fabs(drives) <= friction_level(p, 0.0) ? 0.0 : copysign(1.0, drives);
}

static void react(const Plant *p, State *s, double *z) {
  if (s->watch != 0.0 && s->watch * (measured(p, s) - s->level - s->rate * s->t) >= 0.0) s->passed = 1.0;
  if (s->stopped != 0.0 || s->motion == 0.0) {
    if (breaks_away(p, s, z, s->t) > 0.0) {
      s->motion = balance(p, s, z, s->t) < 0.0 ? -1.0 : 1.0;
      s->stopped = 0.0;
    }
  } else if (s->position >= p->stop_high || s->position <= p->stop_low) {
    stop(p, s);
  } else if (s->motion * s->velocity <= 0.0) {
    turn_round(p, s, z);
  }
}

static bool goes_by_matrix(const Plant *p, State *s, double t) {
  double h = t - s->t;
  const bool ends = h <= p->longest_exact * (1.0 + ROUNDING);
  if (!ends) h /= ceil(h / p->longest_exact - ROUNDING);
  const int k = kept(p, s, h);
  if (k < 0) return false;
  const double now[STATES] = {s->pressure,  s->velocity, s->position, s->velocity2,
                              s->position2, s->bristle,  s->lagged};
  double then[STATES];
  matrix_step(p, s, now, opening(p, s->target), k, then);
  if (event(p, s, then, h) > 0.0 || !linear_now(p, s, then[VELOCITY])) return false;
  s->t = ends ? t : s->t + h;
  s->pressure = then[PRESSURE], s->velocity = then[VELOCITY], s->position = then[POSITION];
  s->velocity2 = then[VELOCITY2], s->position2 = then[POSITION2];
  s->bristle = then[BRISTLE], s->lagged = then[LAGGED];
  s->followed = followed(p, s, s->position);
  s->spool = s->target;
  s->steps += MATRIX_COST;
  return true;
}

static bool goes_freely(const Plant *p, State *s, double t) {
  if (s->motion == 0.0 || s->stopped != 0.0 || s->watch != 0.0 || p->longest_exact == 0.0) return false;
  if (!linear_now(p, s, s->velocity)) return false;
  if (p->by_matrix != 0.0) return goes_by_matrix(p, s, t);
  const double left = t - s->t, h = min(left, p->longest_exact);
  const double now[STATES] = {s->pressure,  s->velocity, s->position, s->velocity2,
                              s->position2, s->bristle,  s->lagged};
  double then[STATES];
  exact_step(p, s, now, h, then);
  if (event(p, s, then, h) > 0.0 || !linear_now(p, s, then[VELOCITY])) return false;
  s->t = h == left ? t : s->t + h;
  s->pressure = then[PRESSURE], s->velocity = then[VELOCITY], s->position = then[POSITION];
  s->velocity2 = then[VELOCITY2], s->position2 = then[POSITION2];
  s->followed = followed(p, s, s->position);
  s->spool = p->valve_lag_time > 0.0 ? spool_at(p, s, h) : s->target;
  s->steps += COST;
  return true;
}

static void advance(const Plant *p, State *s, double t) {
  s->passed = 0.0;
  if (s->velocity * s->motion < 0.0) s->motion = -s->motion;
  while (s->t < t && goes_freely(p, s, t)) continue;
  if (s->t >= t) return;
  const double longest = longest_substep(p, s, t);
  for (long events = 0; s->t < t;) {
    bool ends;
    const double h = next_substep(p, s, t - s->t, longest, &ends);
    const double now[STATES] = {s->pressure,  s->velocity, s->position, s->velocity2,
                                s->position2, s->bristle,  s->lagged};
    double then[STATES];
    step(p, s, now, h, then);
    if (events > MOST_EVENTS || event(p, s, then, h) <= 0.0) {
      accept(p, s, then, h);
      if (ends) s->t = t;
      continue;
    }
    const double high = locate(p, s, now, h);
    step(p, s, now, high, then);
    accept(p, s, then, high);
    react(p, s, then);
    events++;
    if (s->passed != 0.0) break;
  }
}

/* Runs: sim/runs.py, with constant supply and temperature and without noise */

static long deliver(const Plant *p, State *s, const double *t_u, const double *u, long given, long made, double t) {
  for (; given < made && t_u[given] + p->transport_delay_time <= t; given++) {
    advance(p, s, max(s->t, t_u[given] + p->transport_delay_time));
    command(p, s, u[given]);
  }
  advance(p, s, t);
  return given;
}

static double reading(const Plant *p, const State *s) {
  return s->taken > -INFINITY ? s->reading : quantized(p, measured(p, s));
}

static long sampled(const Plant *p, State *s, const double *t_u, const double *u, long given, long made, double t) {
  const double hold = p->held_readings_time;
  if (hold != 0.0) {
    const double due = min(s->origin + floor((t - s->origin) / hold + ON_TIME) * hold, t);
    if (due > s->taken + 0.5 * hold) {
      given = deliver(p, s, t_u, u, given, made, due);
      s->reading = quantized(p, measured(p, s));
      s->taken = due;
    }
  }
  return deliver(p, s, t_u, u, given, made, t);
}

void follow(const Plant *p, State *s, const double *t_u, const double *u, const double *t, long rows, double *y) {
  long given = 0;
  for (long k = 0; k < rows; k++) {
    given = sampled(p, s, t_u, u, given, rows, t[k]);
    y[k] = reading(p, s);
  }
}

void sampled_relay(const Plant *p, State *s, const Relay *r, const double *t, long rows, double *y, double *u,
                   double *t_u) {
  long given = 0;
  double sign = 1.0;
  for (long k = 0; k < rows; k++) {
    given = sampled(p, s, t_u, u, given, k, t[k]);
    y[k] = reading(p, s);
    const double signal = y[k] - r->reference;
    if (fabs(signal) > r->hysteresis) sign = signal > 0.0 ? -1.0 : 1.0;
    u[k] = r->bias + sign * r->e_a;
    t_u[k] = t[k] + r->latency;
  }
}

long ideal_relay(const Plant *p, State *s, const Relay *r, const double *t, long rows, double *y, double *switches,
                 long most) {
  double sign = 1.0, due = INFINITY;
  long count = 0;
  command(p, s, r->bias + r->e_a);
  for (long k = 0; k < rows; k++) {
    while (s->t < t[k]) {
      s->watch = due == INFINITY ? sign : 0.0;
      s->level = r->reference + sign * r->hysteresis;
      advance(p, s, min(due, t[k]));
      if (s->passed != 0.0) {
        if (count < most) switches[count] = s->t;
        count++;
        sign = -sign;
        due = s->t + r->latency + p->transport_delay_time;
        s->passed = 0.0;
      }
      if (s->t >= due) {
        command(p, s, r->bias + sign * r->e_a);
        due = INFINITY;
      }
    }
    y[k] = measured(p, s);
  }
  s->watch = 0.0;
  return count;
}
