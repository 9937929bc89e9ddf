/* What a board does with the serial line: docs/serial.md. The hardware is behind four functions. */
#ifndef SEOD_BOARD_H
#define SEOD_BOARD_H

#include "seod_frame.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Bits of `status`. */
enum { SEOD_NEUTRAL = 1, SEOD_OVERRUN = 2, SEOD_DROPPED = 4, SEOD_BAD_COMMAND = 8 };

struct seod_board_config {
  const char *inputs;  /* codes of the fields, in order, such as "iB" */
  const char *outputs; /* likewise, such as "h" */
  const char *name;    /* of the board, for messages */
  uint32_t period_us;  /* between samples */
  uint16_t watchdog_ms;
  void *context; /* handed to the functions below */

  /* Reads the inputs into a block. */
  void (*read_inputs)(void *context, uint8_t *block);
  /* Sets the outputs from a block. */
  void (*write_outputs)(void *context, const uint8_t *block);
  /* Sets the outputs so that the rig stands still. */
  void (*neutral)(void *context);
  /* Sends all of it without waiting, or nothing; whether it was sent. */
  bool (*transmit)(void *context, const uint8_t *data, size_t length);
};

/* Begun by seod_board_begin; its members are nobody else's. */
struct seod_board {
  struct seod_board_config config;
  struct seod_parser parser;
  size_t inputs, outputs; /* bytes of the blocks */
  uint32_t next_us;       /* sample */
  uint32_t commanded_us;  /* last command set */
  uint8_t sequence;       /* of the next sample */
  uint8_t ack;            /* sequence of the last command */
  uint8_t status;
  bool sampling, any_command, driven, ack_known;
};

/* At power-on: outputs neutral, silent. False if the layout has an unknown code or does not fit into a frame. */
bool seod_board_begin(struct seod_board *board, const struct seod_board_config *config, uint32_t now_us);

/* Takes bytes that came. */
void seod_board_receive(struct seod_board *board, const uint8_t *data, size_t length, uint32_t now_us);

/* To be called as often as possible: samples when it is time, and goes to neutral when commands stop. */
void seod_board_poll(struct seod_board *board, uint32_t now_us);

#ifdef __cplusplus
}
#endif
#endif
