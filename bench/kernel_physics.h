/* The plant's equations in C, for bench/kernel.c: sim/physics.py, function by function. */
#include <math.h>
#include <stdbool.h>
#include "kernel_records.h"

enum { PRESSURE, VELOCITY, POSITION, VELOCITY2, POSITION2, BRISTLE, LAGGED, STATES };

/* The library's fmin and fmax are calls at -O2, for the sake of NaNs that do not occur here. */
static inline double min(double a, double b) { return b < a ? b : a; }
static inline double max(double a, double b) { return b > a ? b : a; }
static inline double clip(double x, double low, double high) { return min(max(x, low), high); }

static double opening(const Plant *p, double spool) {
  const double from_centre = spool - p->null_shift_voltage, overlap = p->valve_deadband_half_width;
  if (from_centre > overlap) return (from_centre - overlap) * (1.0 + p->asymmetric_gain_ratio);
  if (from_centre < -overlap) return (from_centre + overlap) * (1.0 - p->asymmetric_gain_ratio);
  return 0.0;
}

static double spool_at(const Plant *p, const State *s, double h) {
  if (p->valve_lag_time == 0.0) return s->target;
  return s->target + (s->spool - s->target) * exp(-h / p->valve_lag_time);
}

static double flow(const Plant *p, const State *s, double opened, double pressure, double gain) {
  const double most = p->square_root_flow_supply;
  if (most == INFINITY) return gain * opened;
  const double supply = max(s->supply, VACUUM);
  const double drop = 1.0 - copysign(pressure, opened * pressure) / (most * supply);
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

static double drive(const Plant *p, const State *s, double t, double pressure, double position, double coupled) {
  double total = pressure - p->load_bias_acceleration - p->load_spring_stiffness * (position - p->load_spring_centre);
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
  return p->lugre_friction_stiffness == 0.0 && friction_level(p, 0.0) > 0.0;
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

static bool in_contact(const Plant *p, const State *s) {
  const double half = 0.5 * p->backlash_gap, rounding = 1e-15 * fabs(s->position);
  return s->motion * (s->position - s->followed) >= half * (1.0 - 1e-9) - rounding;
}

static double seen(const Plant *p, const State *s, double position, double velocity) {
  const double behind = followed(p, s, position);
  if (p->measures_speed == 0.0) return rippled(p, behind);
  if (p->backlash_gap > 0.0 && !in_contact(p, s)) return 0.0;
  if (p->position_ripple_amplitude == 0.0) return velocity;
  const double angle = p->position_ripple_wavenumber * behind + p->position_ripple_phase;
  return velocity * (1.0 + p->position_ripple_amplitude * p->position_ripple_wavenumber * cos(angle));
}

static void rates(const Plant *p, const State *s, const double *z, double t, double opened, double *d) {
  const double since = t - s->origin, warmth = s->warmth;
  const double gain = p->K_L * drifted(p->parameter_drift_K_L, p->parameter_drift_K_L_thermal, since, warmth);
  const double omega =
      p->omega_n * drifted(p->parameter_drift_omega_n, p->parameter_drift_omega_n_thermal, since, warmth);
  const double zeta = p->zeta * drifted(p->parameter_drift_zeta, p->parameter_drift_zeta_thermal, since, warmth);
  const double speed = flow(p, s, opened, z[PRESSURE], gain);
  d[PRESSURE] = stiffness(p, s) * (omega * omega * (speed - z[VELOCITY]) - 2.0 * zeta * omega * z[PRESSURE]);

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
    d[VELOCITY] = (1.0 + ratio) * (drive(p, s, t, z[PRESSURE], z[POSITION], coupled) - friction);
  d[POSITION] = z[VELOCITY];
  d[VELOCITY2] = ratio == 0.0 ? d[VELOCITY] : coupled;
  d[POSITION2] = ratio == 0.0 ? z[VELOCITY] : z[VELOCITY2];
  d[LAGGED] = 0.0;
  if (p->sensor_lag_time > 0.0)
    d[LAGGED] = (seen(p, s, z[POSITION], z[VELOCITY]) - z[LAGGED]) / p->sensor_lag_time;
}
