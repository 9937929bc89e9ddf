/* The length of a substep in C, for bench/kernel.c: sim/substep.py, function by function. */
#include "kernel_matrix.h"

static double passes(const Plant *p, double before, double after) {
  const double lag = p->valve_lag_time, rate = p->valve_rate_limit_rate, knee = rate * lag;
  if (rate == INFINITY) return lag * log(before / after);
  if (after >= knee) return (before - after) / rate;
  return max(0.0, before - knee) / rate + lag * log(min(before, knee) / after);
}

static double swings_past(const Plant *p, const State *s, double edge, double h) {
  const double before = s->spool - edge;
  double speed, low = 0.0, high = h;
  if (before * (swung(p, s, h, &speed) - edge) >= 0.0) return INFINITY;
  for (int i = 0; i < HALVINGS; i++) {
    const double middle = 0.5 * (low + high);
    if (before * (swung(p, s, middle, &speed) - edge) < 0.0) high = middle;
    else low = middle;
  }
  return high;
}

static double next_edge(const Plant *p, const State *s, double h) {
  double nearest = INFINITY;
  if (!spool_moves(p)) return nearest;
  if (p->valve_rate_limit_rate < INFINITY) {
    const double ramp = ramps_for(p, s);
    if (ramp > 1e-9 * p->valve_lag_time) nearest = ramp;
  }
  const bool ports = p->static_valve_map_at_ports != 0.0;
  const bool bent = ports || p->valve_deadband_half_width > 0.0 || p->asymmetric_gain_ratio != 0.0;
  if (!bent && p->square_root_flow_supply == INFINITY) return nearest;
  for (double side = -1.0; side <= 1.0; side += 2.0) {
    const double edge = p->null_shift_voltage + side * p->valve_deadband_half_width;
    if (swings(p)) {
      nearest = min(nearest, swings_past(p, s, edge, h));
      continue;
    }
    const double before = s->spool - s->target, after = edge - s->target;
    if (before * after > 0.0 && fabs(after) < fabs(before) * (1.0 - 1e-9))
      nearest = min(nearest, passes(p, fabs(before), fabs(after)));
  }
  return nearest;
}

static double longest_substep(const Plant *p, const State *s, double t) {
  double quicker = sqrt(stiffness(p, s));
  double rate = p->parameter_drift_omega_n, thermal = p->parameter_drift_omega_n_thermal;
  if (rate != 0.0 || thermal != 0.0)
    quicker *= drifted(rate, thermal, (rate > 0.0 ? t : s->t) - s->origin, s->warmth);
  rate = p->parameter_drift_zeta, thermal = p->parameter_drift_zeta_thermal;
  if (rate != 0.0 || thermal != 0.0)
    quicker *= max(1.0, drifted(rate, thermal, (rate > 0.0 ? t : s->t) - s->origin, s->warmth));
  return p->substep / max(1.0, quicker);
}

static double within_orifice(const Plant *p, const State *s, double longest) {
  const double speed = fabs(p->K_L) * (fabs(opening(p, s->spool)) + fabs(opening(p, s->target)));
  if (speed == 0.0) return longest;
  const double full = p->square_root_flow_supply;
  const double soft = LAMINAR + fabs(1.0 - fabs(s->pressure) / (full * max(s->supply, VACUUM)));
  const double rate = max(speed / sqrt(soft), (speed + fabs(s->velocity)) / soft);
  const double quicker = p->omega_n * p->substep / longest;
  return 0.5 * full / (quicker * quicker * rate);
}

static double within_ports(const Plant *p, const State *s) {
  double speed = fabs(s->target - s->spool) / max(p->valve_lag_time, 1e-300);
  if (swings(p)) speed = fabs(s->spool_speed) + p->spool_inertia_omega * fabs(s->target - s->spool);
  speed = min(speed, p->valve_rate_limit_rate);
  return PASSES * p->static_valve_map_range / (speed + 1e-300);
}

static double within_bristles(const Plant *p, const State *s, double longest) {
  const double z[STATES] = {[POSITION] = s->position, [VELOCITY2] = s->velocity2, [POSITION2] = s->position2};
  const double ratio = p->load_resonance_inertia;
  const double stiff = p->lugre_friction_stiffness / p->coulomb_friction_level;
  const double coupled = ratio > 0.0 ? coupling(p, s->velocity, z) : 0.0;
  const double rise = p->omega_n * p->omega_n * fabs(p->K_L * s->target) * longest;
  double push = rise + fabs(drive(p, s, s->t, s->pressure, s->position, coupled));
  push += p->lugre_friction_stiffness * fabs(s->bristle) + p->lugre_friction_damping * fabs(s->velocity);
  const double rate = stiff * fabs(s->velocity);
  return 2.0 / (rate + sqrt(rate * rate + 4.0 * stiff * (1.0 + ratio) * push) + 1e-300);
}

static double next_substep(const Plant *p, const State *s, double left, double longest, bool *ends) {
  if (p->square_root_flow_supply < INFINITY)
    longest = min(longest, max(within_orifice(p, s, longest), p->shortest * longest));
  if (p->lugre_friction_stiffness > 0.0 && !settled(p, s)) longest = min(longest, within_bristles(p, s, longest));
  if (p->static_valve_map_at_ports != 0.0 && spool_moves(p)) longest = min(longest, within_ports(p, s));
  longest = max(longest, 1e-9);
  const double pieces = ceil(left / longest - 1e-9);
  const double h = pieces > 1.0 ? left / pieces : left;
  const double edge = next_edge(p, s, h);
  *ends = edge >= h && pieces <= 1.0;
  return edge < h ? edge : h;
}
