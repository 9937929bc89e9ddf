/* Frames of the serial line: docs/serial.md. Portable C99, no allocation, no library but <stdint.h> and friends. */
#ifndef SEOD_FRAME_H
#define SEOD_FRAME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SEOD_VERSION 1

enum {
  SEOD_LARGEST = 252,                  /* bytes of content: type, sequence, body, CRC */
  SEOD_LARGEST_BODY = SEOD_LARGEST - 6,
  SEOD_LARGEST_FRAME = SEOD_LARGEST + 2 /* encoded, with its end */
};

enum { SEOD_HELLO = 0x01, SEOD_SAMPLE = 0x02, SEOD_ASK = 0x81, SEOD_START = 0x82, SEOD_COMMAND = 0x83 };

/* CRC-32 of Ethernet and zlib. */
uint32_t seod_crc32(const uint8_t *data, size_t length);

/* Encodes one frame with its end into `out` (SEOD_LARGEST_FRAME bytes); returns its length, 0 if the body is too long. */
size_t seod_frame_encode(uint8_t type, uint8_t sequence, const uint8_t *body, size_t length, uint8_t *out);

/* What has come of a frame. All zeros is its beginning. */
struct seod_parser {
  uint8_t buffer[SEOD_LARGEST + 1];
  uint16_t length;
  bool overlong;
};

struct seod_frame {
  uint8_t type;
  uint8_t sequence;
  const uint8_t *body; /* within the parser, until the next byte is fed */
  size_t length;
};

enum seod_fed { SEOD_MORE, SEOD_FRAME, SEOD_BROKEN };

/* Takes one byte; SEOD_FRAME: `frame` is filled; SEOD_BROKEN: what came up to this end is no frame. */
enum seod_fed seod_parser_feed(struct seod_parser *parser, uint8_t byte, struct seod_frame *frame);

/* Numbers of blocks, little-endian. */
void seod_put16(uint8_t *to, uint16_t number);
void seod_put32(uint8_t *to, uint32_t number);
void seod_put_float(uint8_t *to, float number);
uint16_t seod_get16(const uint8_t *from);
uint32_t seod_get32(const uint8_t *from);
float seod_get_float(const uint8_t *from);

#ifdef __cplusplus
}
#endif
#endif
