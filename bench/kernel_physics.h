/* The plant's equations in C, for bench/kernel.c: sim/physics.py, function by function. */
#include <math.h>
#include <stdbool.h>
#include "kernel_records.h"

enum { PRESSURE, VELOCITY, POSITION, VELOCITY2, POSITION2, BRISTLE, LAGGED, STATES };

/* The library's fmin and fmax are calls at -O2, for the sake of NaNs that do not occur here. */
static inline double min(double a, double b) { return b < a ? b : a; }
static inline double max(double a, double b) { return b > a ? b : a; }
static inline double clip(double x, double low, double high) { return min(max(x, low), high); }

static double corner(double s, double at, double rounding) {
  const double half = rounding * min(at, 1.0 - at);
  if (s <= at - half) return 0.0;
  if (s >= at + half) return s - at;
  return (s - at + half) * (s - at + half) / (4.0 * half);
}

static double cornered(const Plant *p, double s, double first, double second, double end) {
  const double at_1 = p->static_valve_map_knot_1, at_2 = p->static_valve_map_knot_2;
  const double begins = first / at_1, goes_on = (second - first) / (at_2 - at_1);
  const double ends = (end - second) / (1.0 - at_2), rounding = p->static_valve_map_rounding;
  return begins * s + (goes_on - begins) * corner(s, at_1, rounding) + (ends - goes_on) * corner(s, at_2, rounding);
}

static double mapped(const Plant *p, double volts) {
  if (p->static_valve_map_range == INFINITY) return volts;
  const double s = min(fabs(volts) / p->static_valve_map_range, 1.0);
  const double bend = cornered(p, s, p->static_valve_map_bend_1, p->static_valve_map_bend_2, 0.0);
  const double tilt =
      cornered(p, s, p->static_valve_map_tilt_1, p->static_valve_map_tilt_2, p->static_valve_map_tilt_3);
  return volts + (volts < 0.0 ? -bend : bend) + tilt;
}

static double opening(const Plant *p, double spool) {
  const double from_centre = spool - p->null_shift_voltage, overlap = p->valve_deadband_half_width;
  if (fabs(from_centre) <= overlap) return 0.0;
  const double side = from_centre > 0.0 ? 1.0 : -1.0, opened = from_centre - side * overlap;
  return (p->static_valve_map_at_ports != 0.0 ? mapped(p, opened) : opened) * (1.0 + side * p->asymmetric_gain_ratio);
}

static double ramps_for(const Plant *p, const State *s) {
  const double rate = p->valve_rate_limit_rate;
  return max(0.0, fabs(s->target - s->spool) - rate * p->valve_lag_time) / rate;
}

static bool spool_moves(const Plant *p) { return p->valve_lag_time > 0.0 || p->valve_rate_limit_rate < INFINITY; }

static bool swings(const Plant *p) {
  const bool limited = p->valve_rate_limit_rate < INFINITY;
  return p->spool_inertia_omega < INFINITY && p->valve_lag_time > 0.0 && !limited;
}

static double oscillation(double d, double square, double h, double *odd) {
  const double beyond = d * d - square;
  if (beyond > 0.0) {
    const double k = sqrt(beyond), slow = exp(-h * square / (d + k));
    *odd = slow * -expm1(-2.0 * k * h) / (2.0 * k);
    return slow - k * *odd;
  }
  const double fading = exp(-d * h), k = sqrt(-beyond);
  *odd = k == 0.0 ? fading * h : fading * sin(k * h) / k;
  return fading * cos(k * h);
}

static double swung(const Plant *p, const State *s, double h, double *speed_then) {
  const double square = p->spool_inertia_omega * p->spool_inertia_omega, d = 0.5 * p->valve_lag_time * square;
  const double off = s->spool - s->target, speed = s->spool_speed;
  double odd;
  const double even = oscillation(d, square, h, &odd);
  *speed_then = even * speed - odd * (d * speed + square * off);
  return s->target + even * off + odd * (speed + d * off);
}

static double spool_at(const Plant *p, const State *s, double h) {
  const double lag = p->valve_lag_time, rate = p->valve_rate_limit_rate;
  if (rate < INFINITY) {
    const double ramp = ramps_for(p, s), way = s->target - s->spool;
    if (h < ramp) return s->spool + copysign(rate * h, way);
    if (lag == 0.0) return s->target;
    return s->target - copysign(min(fabs(way), rate * lag) * exp((ramp - h) / lag), way);
  }
  if (lag == 0.0) return s->target;
  double speed;
  if (p->spool_inertia_omega < INFINITY) return swung(p, s, h, &speed);
  return s->target + (s->spool - s->target) * exp(-h / lag);
}

static double flow(const Plant *p, const State *s, double opened, double pressure, double gain) {
  const double most = p->square_root_flow_supply;
  if (most == INFINITY) return gain * opened;
  const double supply = max(s->supply, VACUUM);
  const double drop = 1.0 - copysign(pressure, gain * opened * pressure) / (most * supply);
  const double orifice = drop * pow((1.0 + LAMINAR * LAMINAR) / (drop * drop + LAMINAR * LAMINAR), 0.25);
  return gain * opened * sqrt(supply) * orifice;
}

static double drifted(double rate, double thermal, double t, double warmth) {
  return max(0.05, 1.0 + rate * t + thermal * warmth);
}

static double stiffness(const Plant *p, const State *s) {
  const double air = p->pressure_dependent_stiffness_air;
  if (air == 0.0) return 1.0;
  const double supply = max(s->supply, VACUUM);
  return (1.0 + air) / (1.0 + air / (supply * supply));
}

static double steady_drive(const Plant *p, const State *s, double t, double pressure, double position) {
  double total = pressure - p->load_bias_acceleration - p->load_spring_stiffness * (position - p->load_spring_centre);
  total -= p->load_bias_drift * (t - s->origin);
  return total + p->measured_disturbance_gain * (s->force - p->measured_disturbance_zero);
}

static double drive(const Plant *p, const State *s, double t, double pressure, double position, double coupled) {
  double total = steady_drive(p, s, t, pressure, position);
  if (p->periodic_disturbance_amplitude != 0.0)
    total += p->periodic_disturbance_amplitude *
             sin(p->periodic_disturbance_omega * (t - s->origin) + p->periodic_disturbance_phase);
  const double ratio = p->load_resonance_inertia;
  return total - ratio / (1.0 + ratio) * coupled;
}

static double coupling(const Plant *p, double velocity, const double *z) {
  const double omega = p->load_resonance_omega;
  return omega * omega * (z[POSITION] - z[POSITION2]) +
         2.0 * p->load_resonance_zeta * omega * (velocity - z[VELOCITY2]);
}

static double friction_level(const Plant *p, double speed) {
  double level = p->coulomb_friction_level;
  if (p->stribeck_friction_level > 0.0) {
    const double relative = speed / p->stribeck_friction_speed;
    level += p->stribeck_friction_level * exp(-relative * relative);
  }
  return level;
}

static bool dry_friction(const Plant *p) {
  return p->lugre_friction_stiffness == 0.0 && p->coulomb_friction_level + p->stribeck_friction_level > 0.0;
}

static bool settled(const Plant *p, const State *s) {
  if (p->stribeck_friction_level > 0.0) return false;
  const double bears = s->motion * p->lugre_friction_stiffness * s->bristle;
  return fabs(bears - p->coulomb_friction_level) <= SETTLED * p->coulomb_friction_level;
}

static double followed(const Plant *p, const State *s, double position) {
  const double half = 0.5 * p->backlash_gap;
  return clip(s->followed, position - half, position + half);
}

static double rippled(const Plant *p, double position) {
  if (p->position_ripple_amplitude == 0.0) return position;
  return position + p->position_ripple_amplitude *
                        sin(p->position_ripple_wavenumber * position + p->position_ripple_phase);
}

static bool bends(const Plant *p) {
  return p->sensor_nonlinearity_order_2 != 0.0 || p->sensor_nonlinearity_order_3 != 0.0 ||
         p->sensor_nonlinearity_order_4 != 0.0 || p->sensor_nonlinearity_order_5 != 0.0 ||
         p->sensor_nonlinearity_order_6 != 0.0;
}

static double bend(const Plant *p, double position, double *slope) {
  const double along = (position - p->sensor_nonlinearity_centre) / p->sensor_nonlinearity_half;
  const double z = clip(along, -1.0, 1.0), z2 = z * z, z4 = z2 * z2;
  const double a = p->sensor_nonlinearity_order_2, b = p->sensor_nonlinearity_order_3;
  const double c = p->sensor_nonlinearity_order_4, d = p->sensor_nonlinearity_order_5;
  const double e = p->sensor_nonlinearity_order_6;
  double value = a * (1.5 * z2 - 0.5) + b * z * (2.5 * z2 - 1.5) + c * (4.375 * z4 - 3.75 * z2 + 0.375);
  value += d * z * (7.875 * z4 - 8.75 * z2 + 1.875);
  value += e * (14.4375 * z4 * z2 - 19.6875 * z4 + 6.5625 * z2 - 0.3125);
  double rises = a * 3.0 * z + b * (7.5 * z2 - 1.5) + c * z * (17.5 * z2 - 7.5);
  rises += d * (39.375 * z4 - 26.25 * z2 + 1.875) + e * z * (86.625 * z4 - 78.75 * z2 + 13.125);
  *slope = rises / p->sensor_nonlinearity_half;
  return value + rises * (along - z);
}

static double encoded(const Plant *p, double position) {
  double slope;
  return bends(p) ? rippled(p, position) + bend(p, position, &slope) : rippled(p, position);
}

static bool in_contact(const Plant *p, const State *s) {
  const double half = 0.5 * p->backlash_gap, rounding = 1e-15 * fabs(s->position);
  return s->motion * (s->position - s->followed) >= half * (1.0 - 1e-9) - rounding;
}

static double sensed(const Plant *p, const State *s, double position, double velocity) {
  const double behind = followed(p, s, position);
  if (p->measures_speed == 0.0) return encoded(p, behind);
  if (p->backlash_gap > 0.0 && !in_contact(p, s)) return 0.0;
  double slope = 0.0;
  if (bends(p)) bend(p, behind, &slope);
  slope += 1.0;
  if (p->position_ripple_amplitude == 0.0) return velocity * slope;
  const double angle = p->position_ripple_wavenumber * behind + p->position_ripple_phase;
  return velocity * (slope + p->position_ripple_amplitude * p->position_ripple_wavenumber * cos(angle));
}

static double rectified(const Plant *p, double value) {
  const double range = p->rectified_sensor_range;
  if (p->rectified_sensor_power != 1.0)
    value = copysign(range * pow(fabs(value) / range, p->rectified_sensor_power), value);
  return value >= 0.0 ? value : (1.0 - 2.0 * p->rectified_sensor_part) * value;
}

static double seen(const Plant *p, const State *s, double position, double velocity) {
  return rectified(p, sensed(p, s, position, velocity));
}

static void rates(const Plant *p, const State *s, const double *z, double t, double opened, double *d) {
  const double since = t - s->origin, warmth = s->warmth;
  const double gain = p->K_L * drifted(p->parameter_drift_K_L, p->parameter_drift_K_L_thermal, since, warmth);
  const double omega =
      p->omega_n * drifted(p->parameter_drift_omega_n, p->parameter_drift_omega_n_thermal, since, warmth);
  const double zeta = p->zeta * drifted(p->parameter_drift_zeta, p->parameter_drift_zeta_thermal, since, warmth);
  const double speed = flow(p, s, opened, z[PRESSURE], gain);
  const double rubs = p->viscous_friction_share * 2.0 * zeta * omega, leaks = 2.0 * zeta * omega - rubs;
  d[PRESSURE] = stiffness(p, s) * (omega * omega * (speed - z[VELOCITY]) - leaks * z[PRESSURE]);

  const double ratio = p->load_resonance_inertia;
  const double coupled = ratio > 0.0 ? coupling(p, z[VELOCITY], z) : 0.0;
  double friction = 0.0;
  d[BRISTLE] = 0.0;
  if (p->lugre_friction_stiffness > 0.0 && !settled(p, s)) {
    const double level = friction_level(p, z[VELOCITY]);
    d[BRISTLE] = z[VELOCITY] - p->lugre_friction_stiffness * fabs(z[VELOCITY]) / level * z[BRISTLE];
    friction = p->lugre_friction_stiffness * z[BRISTLE] + p->lugre_friction_damping * d[BRISTLE];
  } else if (s->motion != 0.0) {
    friction = s->motion * friction_level(p, z[VELOCITY]);
  }
  d[VELOCITY] = 0.0;
  if (s->motion != 0.0 && s->stopped == 0.0)
    d[VELOCITY] = (1.0 + ratio) * (drive(p, s, t, z[PRESSURE], z[POSITION], coupled) - rubs * z[VELOCITY] - friction);
  d[POSITION] = z[VELOCITY];
  d[VELOCITY2] = ratio == 0.0 ? d[VELOCITY] : coupled;
  d[POSITION2] = ratio == 0.0 ? z[VELOCITY] : z[VELOCITY2];
  d[LAGGED] = 0.0;
  if (p->sensor_lag_time > 0.0)
    d[LAGGED] = (seen(p, s, z[POSITION], z[VELOCITY]) - z[LAGGED]) / p->sensor_lag_time;
}
