/* The reference firmware as a process: it makes a pseudo terminal behind LINK, and has a motor to move.
 *
 *   board LINK [OMEGA_N ZETA]
 *
 * Inputs: angle (int32, 1e-5 rad), run_enable (uint8); output: valve (int16, 1e-3 V); 2000 samples per second.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include "../seod_board.h"

enum { PERIOD_US = 500, WATCHDOG_MS = 50 };

/* Eq. 1 and its integral, exact between commands: solved in the coordinates of its poles (zeta < 1). */
struct motor {
  double K_L, omega_n, zeta;
  double volts, speed, acceleration, angle;
  double t; /* [s] */
};

struct rig {
  struct motor motor;
  int line;
  double begun;
};

static volatile sig_atomic_t ended;

static void on_signal(int number) {
  (void)number;
  ended = 1;
}

static double now_s(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void advance(struct motor *m, double t) {
  double h = t - m->t, w = m->omega_n, a = m->zeta * w, d = w * sqrt(1.0 - m->zeta * m->zeta);
  double e = exp(-a * h), c = cos(d * h), s = sin(d * h), steady = m->K_L * m->volts;
  double x = m->speed - steady, v = m->acceleration;
  m->t = t;
  m->angle += steady * h + (2.0 * a * x + v - e * ((2.0 * a * x + v) * c + ((a * v + (2.0 * a * a - w * w) * x) / d) * s)) / (w * w);
  m->speed = steady + e * (x * c + (v + a * x) / d * s);
  m->acceleration = e * (v * c - (w * w * x + a * v) / d * s);
}

static void command(struct rig *rig, double volts) {
  advance(&rig->motor, now_s());
  rig->motor.volts = volts;
}

static void read_inputs(void *context, uint8_t *block) {
  struct rig *rig = context;
  advance(&rig->motor, now_s());
  seod_put32(block, (uint32_t)(int32_t)lround(rig->motor.angle * 1e5));
  block[4] = 1;
}

static void write_outputs(void *context, const uint8_t *block) { command(context, 1e-3 * (int16_t)seod_get16(block)); }

static void neutral(void *context) { command(context, 0.0); }

static bool transmit(void *context, const uint8_t *data, size_t length) {
  struct rig *rig = context;
  return write(rig->line, data, length) == (ssize_t)length;
}

static uint32_t micros(const struct rig *rig) { return (uint32_t)(uint64_t)((now_s() - rig->begun) * 1e6); }

static int make_line(const char *link_path) {
  int line = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (line < 0 || grantpt(line) || unlockpt(line)) {
    return -1;
  }
  int other = open(ptsname(line), O_RDWR | O_NOCTTY | O_CLOEXEC); /* kept: the line lives without a daemon */
  struct termios raw;
  if (other < 0 || tcgetattr(other, &raw)) {
    return -1;
  }
  cfmakeraw(&raw);
  tcsetattr(other, TCSANOW, &raw);
  unlink(link_path);
  return symlink(ptsname(line), link_path) ? -1 : line;
}

static void run(struct seod_board *board, struct rig *rig) {
  uint8_t data[4096];
  while (!ended) {
    int32_t left_us = (int32_t)(board->next_us - micros(rig));
    long wait_us = board->sampling && left_us < PERIOD_US ? (left_us > 0 ? left_us : 0) : PERIOD_US;
    struct timespec wait = {0, wait_us * 1000};
    struct pollfd ready = {rig->line, POLLIN, 0};
    if (ppoll(&ready, 1, &wait, NULL) > 0) {
      ssize_t length = read(rig->line, data, sizeof data);
      if (length > 0) {
        seod_board_receive(board, data, (size_t)length, micros(rig));
      }
    }
    seod_board_poll(board, micros(rig));
  }
}

int main(int count, char **words) {
  if (count != 2 && count != 4) {
    fprintf(stderr, "usage: board LINK [OMEGA_N ZETA]\n");
    return 2;
  }
  struct rig rig = {.motor = {.K_L = 17.0, .omega_n = 117.0, .zeta = 0.21}, .begun = now_s()};
  rig.motor.t = rig.begun;
  if (count == 4) {
    rig.motor.omega_n = atof(words[2]);
    rig.motor.zeta = atof(words[3]);
  }
  if (!(rig.motor.omega_n > 0.0 && rig.motor.zeta > 0.0 && rig.motor.zeta < 1.0)) {
    fprintf(stderr, "OMEGA_N must be above 0, ZETA between 0 and 1\n");
    return 2;
  }
  rig.line = make_line(words[1]);
  if (rig.line < 0) {
    perror(words[1]);
    return 1;
  }
  struct seod_board_config config = {
      .inputs = "iB", .outputs = "h", .name = "posix", .period_us = PERIOD_US, .watchdog_ms = WATCHDOG_MS,
      .context = &rig, .read_inputs = read_inputs, .write_outputs = write_outputs, .neutral = neutral,
      .transmit = transmit};
  struct seod_board board;
  struct sigaction action = {.sa_handler = on_signal};
  sigaction(SIGTERM, &action, NULL);
  sigaction(SIGINT, &action, NULL);
  prctl(PR_SET_TIMERSLACK, 1, 0, 0, 0);
  if (!seod_board_begin(&board, &config, micros(&rig))) {
    fprintf(stderr, "the layout does not fit\n");
    return 1;
  }
  printf("{\"board\": \"ready\", \"port\": \"%s\", \"begun\": %.9f}\n", words[1], rig.begun);
  fflush(stdout);
  run(&board, &rig);
  unlink(words[1]);
  return 0;
}
