#include "seod_board.h"

#include <string.h>

enum { SAMPLE_HEAD = 8, HELLO_HEAD = 8, NEVER = 0xffff };

static bool block_size(const char *codes, size_t *size) {
  *size = 0;
  for (; *codes; codes++) {
    if (strchr("bB", *codes)) {
      *size += 1;
    } else if (strchr("hH", *codes)) {
      *size += 2;
    } else if (strchr("iIf", *codes)) {
      *size += 4;
    } else {
      return false;
    }
  }
  return *size > 0 && *size <= SEOD_LARGEST_BODY - SAMPLE_HEAD;
}

static void go_neutral(struct seod_board *board) {
  board->driven = false;
  board->config.neutral(board->config.context);
}

bool seod_board_begin(struct seod_board *board, const struct seod_board_config *config, uint32_t now_us) {
  memset(board, 0, sizeof *board);
  board->config = *config;
  go_neutral(board);
  board->next_us = now_us;
  size_t hello = HELLO_HEAD + strlen(config->inputs) + strlen(config->outputs) + strlen(config->name) + 2;
  return block_size(config->inputs, &board->inputs) && block_size(config->outputs, &board->outputs) &&
         hello <= SEOD_LARGEST_BODY && config->period_us > 0;
}

static bool send(struct seod_board *board, uint8_t type, uint8_t sequence, const uint8_t *body, size_t length) {
  uint8_t frame[SEOD_LARGEST_FRAME];
  size_t size = seod_frame_encode(type, sequence, body, length, frame);
  return board->config.transmit(board->config.context, frame, size);
}

static size_t append(uint8_t *to, const char *text) {
  size_t length = strlen(text);
  memcpy(to, text, length);
  return length;
}

static void send_hello(struct seod_board *board) {
  const struct seod_board_config *config = &board->config;
  uint8_t body[SEOD_LARGEST_BODY];
  size_t at = HELLO_HEAD;
  body[0] = SEOD_VERSION;
  body[1] = board->driven ? 0 : SEOD_NEUTRAL;
  seod_put32(body + 2, (uint32_t)(1000000000u / config->period_us));
  seod_put16(body + 6, config->watchdog_ms);
  at += append(body + at, config->inputs);
  body[at++] = '/';
  at += append(body + at, config->outputs);
  body[at++] = 0;
  at += append(body + at, config->name);
  send(board, SEOD_HELLO, 0, body, at);
}

static void take_command(struct seod_board *board, const struct seod_frame *frame, uint32_t now_us) {
  if (board->any_command && frame->sequence == board->ack) {
    return; /* a repeat */
  }
  board->config.write_outputs(board->config.context, frame->body);
  board->ack = frame->sequence;
  board->commanded_us = now_us;
  board->any_command = board->driven = board->ack_known = true;
}

static bool of_our_version(const struct seod_frame *frame) {
  return frame->length == 1 && frame->body[0] == SEOD_VERSION;
}

static void take_frame(struct seod_board *board, const struct seod_frame *frame, uint32_t now_us) {
  switch (frame->type) {
    case SEOD_ASK:
      board->sampling = board->any_command = board->ack_known = false;
      go_neutral(board);
      send_hello(board);
      break;
    case SEOD_START:
      if (of_our_version(frame) && !board->sampling) {
        board->sampling = true;
        board->next_us = now_us;
      }
      break;
    case SEOD_COMMAND:
      if (board->sampling && frame->length == board->outputs) {
        take_command(board, frame, now_us);
      }
      break;
    default:
      break;
  }
}

void seod_board_receive(struct seod_board *board, const uint8_t *data, size_t length, uint32_t now_us) {
  struct seod_frame frame;
  for (size_t i = 0; i < length; i++) {
    switch (seod_parser_feed(&board->parser, data[i], &frame)) {
      case SEOD_FRAME:
        take_frame(board, &frame, now_us);
        break;
      case SEOD_BROKEN:
        board->status |= SEOD_BAD_COMMAND;
        break;
      case SEOD_MORE:
        break;
    }
  }
}

static void send_sample(struct seod_board *board, uint32_t now_us) {
  uint8_t body[SEOD_LARGEST_BODY];
  uint32_t age = now_us - board->commanded_us;
  bool known = board->ack_known && age < NEVER;
  board->ack_known = known; /* the clock wraps: a time too long ago stays so */
  seod_put32(body, now_us);
  body[4] = board->status | (board->driven ? 0 : SEOD_NEUTRAL);
  body[5] = board->ack;
  seod_put16(body + 6, known ? (uint16_t)age : NEVER);
  board->config.read_inputs(board->config.context, body + SAMPLE_HEAD);
  board->status = 0;
  if (!send(board, SEOD_SAMPLE, board->sequence++, body, SAMPLE_HEAD + board->inputs)) {
    board->status = SEOD_DROPPED;
  }
}

void seod_board_poll(struct seod_board *board, uint32_t now_us) {
  if (board->driven && now_us - board->commanded_us > board->config.watchdog_ms * (uint32_t)1000) {
    go_neutral(board);
  }
  if (!board->sampling || (int32_t)(now_us - board->next_us) < 0) {
    return;
  }
  send_sample(board, now_us);
  board->next_us += board->config.period_us;
  if ((int32_t)(now_us - board->next_us) >= 0) { /* turns were missed: left out, not made up */
    board->status |= SEOD_OVERRUN;
    board->next_us = now_us + board->config.period_us;
  }
}
