#include "seod_frame.h"

#include <string.h>

enum { HEAD = 2, CRC = 4 };

uint32_t seod_crc32(const uint8_t *data, size_t length) {
  /* Of each value of four bits, reflected: small enough for any board. */
  static const uint32_t table[16] = {
      0x00000000u, 0x1db71064u, 0x3b6e20c8u, 0x26d930acu, 0x76dc4190u, 0x6b6b51f4u, 0x4db26158u, 0x5005713cu,
      0xedb88320u, 0xf00f9344u, 0xd6d6a3e8u, 0xcb61b38cu, 0x9b64c2b0u, 0x86d3d2d4u, 0xa00ae278u, 0xbdbdf21cu};
  uint32_t crc = 0xffffffffu;
  for (size_t i = 0; i < length; i++) {
    crc ^= data[i];
    crc = (crc >> 4) ^ table[crc & 15u];
    crc = (crc >> 4) ^ table[crc & 15u];
  }
  return ~crc;
}

void seod_put16(uint8_t *to, uint16_t number) {
  to[0] = (uint8_t)number;
  to[1] = (uint8_t)(number >> 8);
}

void seod_put32(uint8_t *to, uint32_t number) {
  seod_put16(to, (uint16_t)number);
  seod_put16(to + 2, (uint16_t)(number >> 16));
}

void seod_put_float(uint8_t *to, float number) {
  uint32_t bits;
  memcpy(&bits, &number, sizeof bits);
  seod_put32(to, bits);
}

uint16_t seod_get16(const uint8_t *from) { return (uint16_t)(from[0] | (uint16_t)from[1] << 8); }

uint32_t seod_get32(const uint8_t *from) { return seod_get16(from) | (uint32_t)seod_get16(from + 2) << 16; }

float seod_get_float(const uint8_t *from) {
  uint32_t bits = seod_get32(from);
  float number;
  memcpy(&number, &bits, sizeof number);
  return number;
}

/* COBS of at most 253 bytes: each zero becomes the distance to the next, the first distance goes ahead. */
static size_t cobs_encode(const uint8_t *content, size_t length, uint8_t *out) {
  size_t code = 0;
  for (size_t i = 0; i < length; i++) {
    if (content[i] != 0) {
      out[i + 1] = content[i];
    } else {
      out[code] = (uint8_t)(i + 1 - code);
      code = i + 1;
    }
  }
  out[code] = (uint8_t)(length + 1 - code);
  out[length + 1] = 0;
  return length + 2;
}

size_t seod_frame_encode(uint8_t type, uint8_t sequence, const uint8_t *body, size_t length, uint8_t *out) {
  uint8_t content[SEOD_LARGEST];
  if (length > SEOD_LARGEST_BODY) {
    return 0;
  }
  content[0] = type;
  content[1] = sequence;
  if (length > 0) {
    memcpy(content + HEAD, body, length);
  }
  seod_put32(content + HEAD + length, seod_crc32(content, HEAD + length));
  return cobs_encode(content, HEAD + length + CRC, out);
}

/* Decodes in place; the length of the content, 0 if it is no COBS. */
static size_t cobs_decode(uint8_t *data, size_t length) {
  size_t next = data[0]; /* where the next code is */
  for (size_t i = 1; i < length; i++) {
    if (i == next) {
      next = i + data[i];
      data[i - 1] = 0;
    } else {
      data[i - 1] = data[i];
    }
  }
  return next == length ? length - 1 : 0;
}

static bool read_frame(struct seod_parser *parser, struct seod_frame *frame) {
  size_t length = cobs_decode(parser->buffer, parser->length);
  if (length < HEAD + CRC) {
    return false;
  }
  length -= CRC;
  if (seod_crc32(parser->buffer, length) != seod_get32(parser->buffer + length)) {
    return false;
  }
  frame->type = parser->buffer[0];
  frame->sequence = parser->buffer[1];
  frame->body = parser->buffer + HEAD;
  frame->length = length - HEAD;
  return true;
}

enum seod_fed seod_parser_feed(struct seod_parser *parser, uint8_t byte, struct seod_frame *frame) {
  if (byte != 0) {
    if (parser->length < sizeof parser->buffer) {
      parser->buffer[parser->length++] = byte;
    } else {
      parser->overlong = true;
    }
    return SEOD_MORE;
  }
  enum seod_fed fed = SEOD_MORE;
  if (parser->length > 0) {
    fed = !parser->overlong && read_frame(parser, frame) ? SEOD_FRAME : SEOD_BROKEN;
  }
  parser->length = 0;
  parser->overlong = false;
  return fed;
}
