/* As much of Arduino's interface as the sketch uses, so that a compiler can read it. */
#include <stddef.h>
#include <stdint.h>

enum { A0 = 14, LOW = 0, HIGH = 1, OUTPUT = 1, INPUT_PULLUP = 2 };

int analogRead(int pin);
void analogWrite(int pin, int value);
void analogReadResolution(int bits);
void analogWriteResolution(int bits);
int digitalRead(int pin);
void pinMode(int pin, int mode);
unsigned long micros();

struct SerialPort {
  void begin(unsigned long baud);
  int available();
  int read();
  int availableForWrite();
  size_t write(const uint8_t *data, size_t length);
};
extern SerialPort Serial;
