// A potentiometer on A0 and a valve (or motor) on an H-bridge, as a seod board: docs/arduino.md.
//
// Put seod_frame.h, seod_frame.c, seod_board.h and seod_board.c beside this file. For boards with 12-bit inputs
// and USB-CDC: Teensy, Uno R4, Due, Zero, RP2040, ESP32-S3. A timer of its own is not needed: poll() keeps the time.
#include "seod_board.h"

const int POTENTIOMETER = A0;
const int ENABLE = 7;  // to ground while the emergency stop chain is closed
const int FORWARD = 5, BACKWARD = 6;  // PWM inputs of the bridge
const int LARGEST_DUTY = 4095;

static seod_board board;

static void setBridge(int16_t millivolts) {
  // 12 V at full duty; the amplifier's own limits come on top
  long duty = (long)millivolts * LARGEST_DUTY / 12000;
  duty = duty > LARGEST_DUTY ? LARGEST_DUTY : duty < -LARGEST_DUTY ? -LARGEST_DUTY : duty;
  analogWrite(FORWARD, duty > 0 ? duty : 0);
  analogWrite(BACKWARD, duty < 0 ? -duty : 0);
}

static void readInputs(void *, uint8_t *block) {
  seod_put16(block, (uint16_t)analogRead(POTENTIOMETER));
  block[2] = digitalRead(ENABLE) == LOW;
}

static void writeOutputs(void *, const uint8_t *block) { setBridge((int16_t)seod_get16(block)); }

static void neutral(void *) { setBridge(0); }

static bool transmit(void *, const uint8_t *data, size_t length) {
  return Serial.availableForWrite() >= (int)length && Serial.write(data, length) == length;
}

void setup() {
  pinMode(ENABLE, INPUT_PULLUP);
  pinMode(FORWARD, OUTPUT);
  pinMode(BACKWARD, OUTPUT);
  analogReadResolution(12);
  analogWriteResolution(12);
  Serial.begin(1000000);
  seod_board_config config = {"HB", "h", "potentiometer", 1000, 50, nullptr,
                              readInputs, writeOutputs, neutral, transmit};
  seod_board_begin(&board, &config, micros());
}

void loop() {
  uint8_t data[64];
  size_t length = 0;
  while (length < sizeof data && Serial.available() > 0) {
    data[length++] = (uint8_t)Serial.read();
  }
  seod_board_receive(&board, data, length, micros());
  seod_board_poll(&board, micros());
}
