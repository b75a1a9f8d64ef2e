/* The reference handle: frames of ../PROTOCOL.md, and what a board has to do. ../Makefile defines the constants of
   one handle: SERIAL_NUMBER, COUNTS_PER_M, INDEX, MOST_MA, FULL_MA, SENSE_UA, LATE_US. */
#include <stdbool.h>
#include <stdint.h>

#define PROTOCOL 2
#define PERIOD_US 1000 /* between two states */
#define BAUD 500000    /* exact at 16 MHz and at 12 MHz */
#define NAME "forefeel-coil"
#define FIRMWARE "2.0"

enum { STATE = 1, COMMAND, IDENTIFY, IDENTITY };
enum { DEADMAN = 1, GRIPPER = 2 };
enum { WATCHDOG = 1, OVERCURRENT = 4, NOT_HOMED = 8 };
enum { ARMED = 4, LAMPS = 8 };

#define FRAME struct __attribute__((packed)) /* little-endian, as both chips are */
#define TEXT(name, text) uint8_t name##_size; char name[sizeof text - 1]
FRAME state { uint8_t kind; uint16_t sequence; uint32_t time_us; int32_t counts, velocity; uint8_t buttons, flags;
              int16_t current_ma; uint16_t crc; };
FRAME command { uint8_t kind; uint16_t sequence; int16_t current_ma; uint8_t lamp; int32_t stage_um; uint8_t enabled;
                uint16_t crc; };
FRAME identify { uint8_t kind, protocol; uint16_t watchdog_ms, limit_ma, crc; };
FRAME identity { uint8_t kind, protocol; uint16_t watchdog_ms, limit_ma, period_us, late_us; uint32_t counts_per_m;
                 TEXT(name, NAME); TEXT(serial, SERIAL_NUMBER); TEXT(firmware, FIRMWARE); uint16_t crc; };

int main(void);
void handle_tick(void);            /* the board's timer calls it each period */
void handle_edge(uint8_t encoder); /* at each edge of the encoder: A + 2 B */
void handle_index(bool high);      /* at each edge of the index */

void board_start(void); /* no current before board_drive, and none after a reset */
bool board_read(uint8_t *byte);
void board_write(uint8_t byte);
void board_alive(void); /* feeds the chip's watchdog */
uint8_t board_buttons(void);
uint16_t board_sense(void); /* counts of the ADC, whichever way the current flows */
void board_drive(bool negative, uint16_t ma);
void board_lamp(bool lit);
