/* The firmware's frames on stdin and stdout, for the tests.
 *
 *   codec encode    lines "type sequence body-in-hex" -> lines of the frame in hex, "-" if it is refused
 *   codec decode    any bytes -> a line "type sequence body-in-hex" for each frame, "broken" for each that is none
 *   codec board     any bytes -> a board takes them, polled after each; its answers on stdout
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "seod_board.h"

static void print_hex(const uint8_t *data, size_t length) {
  for (size_t i = 0; i < length; i++) {
    printf("%02x", data[i]);
  }
  putchar('\n');
}

static int encode(void) {
  static char line[4096];
  while (fgets(line, sizeof line, stdin)) {
    unsigned type, sequence;
    int at = 0;
    uint8_t body[2048], frame[SEOD_LARGEST_FRAME];
    size_t length = 0;
    if (sscanf(line, "%u %u %n", &type, &sequence, &at) != 2) {
      return 1;
    }
    for (const char *digits = line + at; digits[0] > ' ' && digits[1] > ' '; digits += 2) {
      unsigned byte;
      sscanf(digits, "%2x", &byte);
      body[length++] = (uint8_t)byte;
    }
    size_t size = seod_frame_encode((uint8_t)type, (uint8_t)sequence, body, length, frame);
    if (size == 0) {
      puts("-");
    } else {
      print_hex(frame, size);
    }
  }
  return 0;
}

static int decode(void) {
  struct seod_parser parser = {0};
  struct seod_frame frame;
  for (int byte = getchar(); byte != EOF; byte = getchar()) {
    enum seod_fed fed = seod_parser_feed(&parser, (uint8_t)byte, &frame);
    if (fed == SEOD_BROKEN) {
      puts("broken");
    } else if (fed == SEOD_FRAME) {
      printf("%u %u ", frame.type, frame.sequence);
      print_hex(frame.body, frame.length);
    }
  }
  return 0;
}

static void read_inputs(void *context, uint8_t *block) {
  (void)context;
  seod_put32(block, 0x12345678);
  block[4] = 1;
}

static void write_outputs(void *context, const uint8_t *block) {
  fprintf(stderr, "%d\n", (int16_t)seod_get16(block));
  (void)context;
}

static void neutral(void *context) {
  (void)context;
  fputs("neutral\n", stderr);
}

static bool transmit(void *context, const uint8_t *data, size_t length) {
  (void)context;
  return fwrite(data, 1, length, stdout) == length;
}

static int board(void) {
  struct seod_board_config config = {.inputs = "iB", .outputs = "h", .name = "test", .period_us = 500, .watchdog_ms = 50,
                                     .read_inputs = read_inputs, .write_outputs = write_outputs, .neutral = neutral,
                                     .transmit = transmit};
  struct seod_board board;
  uint32_t now_us = 0xfffffff0u; /* it wraps soon */
  if (!seod_board_begin(&board, &config, now_us)) {
    return 1;
  }
  for (int byte = getchar(); byte != EOF; byte = getchar()) {
    uint8_t data = (uint8_t)byte;
    seod_board_receive(&board, &data, 1, now_us);
    now_us += 10;
    seod_board_poll(&board, now_us);
  }
  now_us += 100000; /* silence */
  seod_board_poll(&board, now_us);
  return 0;
}

int main(int count, char **words) {
  if (count == 2 && strcmp(words[1], "encode") == 0) {
    return encode();
  }
  if (count == 2 && strcmp(words[1], "decode") == 0) {
    return decode();
  }
  if (count == 2 && strcmp(words[1], "board") == 0) {
    return board();
  }
  return 2;
}
