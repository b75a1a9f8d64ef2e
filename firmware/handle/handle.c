/* Frames and control, the same on every board. */
#include "handle.h"

#define BACK 8 /* periods over which the velocity is the difference of the counts */

static volatile bool homed = !INDEX;
static volatile uint8_t ticks;
static volatile int32_t counts, counts_then;
static volatile uint32_t time_us;
static bool identified, lit;
static uint8_t flags;
static uint32_t silent_us;
static int16_t asked_ma;
static struct identity identity = {IDENTITY, PROTOCOL, 0, 0, PERIOD_US, LATE_US, COUNTS_PER_M, sizeof NAME - 1, NAME,
                                   sizeof SERIAL_NUMBER - 1, SERIAL_NUMBER, sizeof FIRMWARE - 1, FIRMWARE, 0};

void handle_tick(void) {
    ticks++;
    time_us += PERIOD_US;
    counts_then = counts;
}

void handle_edge(uint8_t encoder) {
    static const int8_t steps[16] = {0, 1, -1, 0, -1, 0, 0, 1, 1, 0, 0, -1, 0, -1, 1, 0};
    static uint8_t states; /* of both lines, before and now */
    states = (states << 2 | encoder) & 15;
    counts += steps[states];
}

void handle_index(bool high) {
    counts = high && !homed ? 0 : counts;
    homed |= high;
}

static uint16_t crc_of(const uint8_t *data, uint8_t size) { /* CRC-16/CCITT-FALSE, a byte a step */
    uint16_t crc = 0xFFFF;
    while (size--) {
        uint8_t x = (uint8_t)(crc >> 8) ^ *data++;
        x ^= x >> 4;
        crc = (uint16_t)(crc << 8) ^ (uint16_t)(x << 12) ^ (uint16_t)(x << 5) ^ x;
    }
    return crc;
}

static void send(uint8_t *frame, uint8_t size) { /* a frame whose last two bytes are for its CRC */
    uint16_t crc = crc_of(frame, size - 2);
    frame[size - 2] = crc & 0xFF;
    frame[size - 1] = crc >> 8;
    board_write(0);
    for (uint8_t at = 0, zero = 0; at <= size; at = ++zero) { /* COBS: how far to the next zero, what is between */
        while (zero < size && frame[zero])
            zero++;
        board_write(zero - at + 1);
        while (at < zero)
            board_write(frame[at++]);
    }
    board_write(0);
}

static int16_t drive(void) { /* sets and returns the current that is asked for, within the limit, or none */
    int16_t most = identity.limit_ma, ma = asked_ma < -most ? -most : asked_ma > most ? most : asked_ma;
    ma = !flags && homed ? ma : 0;
    board_drive(ma < 0, ma < 0 ? -ma : ma);
    board_lamp(lit && !flags);
    return ma;
}

static void identify(const struct identify *asked) {
    identity.watchdog_ms = asked->watchdog_ms;
    identity.limit_ma = asked->limit_ma < MOST_MA ? asked->limit_ma : MOST_MA;
    identified = asked->protocol == PROTOCOL;
    lit = false;
    flags = asked_ma = silent_us = 0;
    drive();
    send((uint8_t *)&identity, sizeof identity);
}

static void take_frame(const uint8_t *frame, uint8_t size) { /* one of another kind or length does nothing */
    const struct command *command = (const void *)frame;
    if (frame[0] == IDENTIFY && size == sizeof(struct identify))
        identify((const void *)frame);
    if (frame[0] != COMMAND || size != sizeof *command || command->lamp >= LAMPS)
        return;
    asked_ma = command->enabled ? command->current_ma : 0;
    lit = command->lamp == ARMED;
    silent_us = 0;
    drive();
}

void handle_take(uint8_t byte) { /* of the host */
    static uint8_t frame[sizeof(struct command) + 2], length;
    if (byte && length < sizeof frame) /* one byte more than a frame of ours: too long up to the next zero */
        frame[length++] = byte;
    if (byte)
        return;
    uint8_t from = 0, size = 0, end = length == sizeof frame ? 0 : length;
    length = 0;
    while (from < end) { /* COBS, in place */
        uint8_t code = frame[from++];
        if (code > end - from + 1)
            return;
        while (--code)
            frame[size++] = frame[from++];
        if (from < end)
            frame[size++] = 0;
    }
    if (size > 2 && crc_of(frame, size - 2) == (uint16_t)(frame[size - 2] | frame[size - 1] << 8))
        take_frame(frame, size);
}

void handle_step(uint8_t passed) { /* how many periods have passed: one, or more when some were missed */
    static struct state now = {.kind = STATE};
    static int32_t before[BACK];
    static uint8_t at;
    board_alive();
    do { /* again if a tick came in between */
        now.time_us = time_us;
        now.counts = counts_then;
    } while (now.time_us != time_us);
    now.velocity = (now.counts - before[at]) * (1000000 / PERIOD_US / BACK);
    before[at] = now.counts;
    at = (at + 1) % BACK;
    if (!identified)
        return;
    int16_t sensed_ma = (uint32_t)board_sense() * SENSE_UA / 1000;
    silent_us += passed * (uint32_t)PERIOD_US;
    flags |= (silent_us > identity.watchdog_ms * 1000UL) * WATCHDOG | (sensed_ma > MOST_MA * 3L / 2) * OVERCURRENT;
    int16_t set_ma = drive();
    now.sequence++;
    now.buttons = board_buttons();
    now.flags = flags | (homed ? 0 : NOT_HOMED);
    now.current_ma = SENSE_UA == 0 ? set_ma : set_ma < 0 ? -sensed_ma : sensed_ma;
    send((uint8_t *)&now, sizeof now);
}

int main(void) {
    board_start();
    for (uint8_t done = 0, passed, byte;; done += passed) {
        passed = ticks - done;
        if (passed)
            handle_step(passed);
        while (board_read(&byte))
            handle_take(byte);
    }
}
