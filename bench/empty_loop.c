/* A loop that only waits, to compare with: absolute deadlines on CLOCK_MONOTONIC, SCHED_FIFO, locked memory.
 *
 * empty_loop RATE_HZ SECONDS PRIORITY prints a histogram of its lateness [us] in cyclictest's form.
 */
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <time.h>

#define BINS 20000

static long counts[BINS];

static long long now_ns(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec * 1000000000LL + t.tv_nsec;
}

int main(int argc, char **argv) {
  if (argc != 4) return 2;
  const long long period = 1e9 / atof(argv[1]);
  const long ticks = atof(argv[1]) * atof(argv[2]);
  const struct sched_param priority = {.sched_priority = atoi(argv[3])};
  if (sched_setscheduler(0, SCHED_FIFO, &priority)) perror("SCHED_FIFO");
  if (mlockall(MCL_CURRENT | MCL_FUTURE)) perror("mlockall");
  long beyond = 0, largest = 0;
  long long deadline = now_ns();
  for (long k = 0; k < ticks; k++) {
    deadline += period;
    const struct timespec until = {deadline / 1000000000, deadline % 1000000000};
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL);
    const long long late = now_ns() - deadline;
    const long us = late / 1000;
    if (us < BINS) counts[us]++; else beyond++;
    if (us > largest) largest = us;
    if (late > period) { /* missed deadlines are skipped, as the loop does */
      deadline += late / period * period;
      k += late / period;
    }
  }
  for (int us = 0; us < BINS; us++)
    if (counts[us]) printf("%06d %06ld\n", us, counts[us]);
  printf("# Max Latencies: %05ld\n# Histogram Overflows: %05ld\n", largest, beyond);
  return 0;
}
