/* The bare line for bench/line.py: eight bytes of CLOCK_MONOTONIC each 500 us into a pseudo terminal behind LINK. */
#define _GNU_SOURCE
#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

int main(int count, char **words) {
  int line = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK);
  if (count != 2 || line < 0 || grantpt(line) || unlockpt(line)) {
    return 1;
  }
  int other = open(ptsname(line), O_RDWR | O_NOCTTY);
  struct termios raw;
  tcgetattr(other, &raw);
  cfmakeraw(&raw);
  tcsetattr(other, TCSANOW, &raw);
  unlink(words[1]);
  if (symlink(ptsname(line), words[1])) {
    return 1;
  }
  prctl(PR_SET_TIMERSLACK, 1, 0, 0, 0);
  struct timespec next;
  clock_gettime(CLOCK_MONOTONIC, &next);
  puts("ready");
  fflush(stdout);
  for (;;) {
    next.tv_nsec += 500000;
    if (next.tv_nsec >= 1000000000) {
      next.tv_nsec -= 1000000000;
      next.tv_sec++;
    }
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &next, NULL);
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    uint64_t stamp = (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
    if (write(line, &stamp, sizeof stamp) < 0) {
      continue; /* nobody reads: left out */
    }
  }
}
