/* RP2040 at its 12 MHz crystal: Raspberry Pi Pico. GPIO 0, 1 UART; 2, 3 encoder A, B; 4 index; 5 deadman and 8
   gripper, switches to ground; 6 PWM of 20 kHz, 600 steps; 7 direction; 25 lamp; 26 current. */
#include "handle.h"

#define REG(address) (*(volatile uint32_t *)(address))
#define SIO(offset) REG(0xD0000000 + (offset))
#define UART(offset) REG(0x40034000 + (offset))
#define EDGES 0x8CC00u /* both of 2 and 3, the rising one of 4 */
#define UNITS (1 << 0 | 1 << 5 | 1 << 8 | 1 << 14 | 1 << 22) /* ADC, pins, pads, PWM, UART */
#define HZ 12000000
#define STEPS 600
extern uint32_t stack_top[], data_load[], data_start[], data_end[], bss_end[];
extern void (*const vectors[])(void);

/* What the boot ROM copies to RAM: sets the flash up (data sheet 4.10.13: command 03, 6 MHz), and starts. */
__attribute__((section(".boot2"), used, noreturn)) void boot2(void) {
    REG(0x18000008) = 0;
    REG(0x18000014) = 2;
    REG(0x18000000) = 31 << 16 | 3 << 8;
    REG(0x18000004) = 0;
    REG(0x180000F4) = 3u << 24 | 2 << 8 | 6 << 2;
    REG(0x18000008) = 1;
    REG(0xE000ED08) = (uint32_t)vectors;
    __asm__ volatile("msr msp, %0\n bx %1" ::"r"(stack_top), "r"(vectors[1]));
    __builtin_unreachable();
}

static void start(void) {
    uint32_t *from = data_load;
    for (uint32_t *to = data_start; to < bss_end; to++)
        *to = to < data_end ? *from++ : 0;
    main();
}

static void edges(void) {
    uint32_t which = REG(0x400140F0) & EDGES;
    REG(0x400140F0) = which;
    handle_edge(SIO(4) >> 2 & 3);
    handle_index(which >> 19);
}

__attribute__((section(".vectors"), used)) void (*const vectors[])(void) = {
    (void (*)(void))stack_top, start, [15] = handle_tick, [16 + 13] = edges};

/* Address, value, and bits to wait for in place of writing; sections of the RP2040 data sheet. */
static const uint32_t setup[][3] = {
    {0x40024000, 0xFABAA0, 0}, {0x40024004, 0, 1u << 31}, {0x40008030, 2, 0}, {0x40008038, 0, 4}, /* 2.16.7, 2.15.7, 2.14.3 */
    {0x40008048, 1 << 11, 0}, {0x40008060, 1 << 11 | 3 << 5, 0}, {0x4000F000, UNITS, 0}, {0x4000C008, 0, UNITS},
    {0x40014004, 2, 0}, {0x4001400C, 2, 0}, {0x40014034, 4, 0}, /* 2.19.6 pins 0, 1: UART; 6: PWM; */
    {0x40014014, 5, 0}, {0x4001401C, 5, 0}, {0x40014024, 5, 0}, {0x4001402C, 5, 0}, /* others: IO */
    {0x4001403C, 5, 0}, {0x40014044, 5, 0}, {0x400140CC, 5, 0}, {0xD0000024, 1 << 7 | 1 << 25, 0},
    {0x4001C00C, 0x5A, 0}, {0x4001C010, 0x5A, 0}, {0x4001C014, 0x5A, 0}, {0x4001C018, 0x5A, 0}, {0x4001C024, 0x5A, 0},
    {0x4001C06C, 0x80, 0}, {0x4004C000, 1 << 3 | 1, 0}, {0x4005004C, STEPS - 1, 0}, {0x4005003C, 1, 0}, /* 4.9.6, 4.5.3 */
    {0x40034024, HZ / 16 / BAUD, 0}, {0x40034028, HZ * 4 / BAUD % 64, 0}, /* 4.2.8 UART */
    {0x4003402C, 3 << 5 | 1 << 4, 0}, {0x40034030, 1 << 9 | 1 << 8 | 1, 0}, /* 8 bits, FIFO */
    {0x40014100, EDGES, 0}, {0xE000E100, 1 << 13, 0}, /* encoder, index */
    {0xE000E014, HZ / 1000000 * PERIOD_US - 1, 0}, {0xE000E018, 0, 0}, {0xE000E010, 7, 0}, /* 2.4.8 SysTick */
    {0x40010008, 0x1FFFC, 0}, {0x4005802C, 1 << 9 | HZ / 1000000, 0}, /* 4.7.6 watchdog: resets all but oscillators */
};

void board_start(void) {
    for (uint8_t one = 0; one < sizeof setup / sizeof *setup; one++) {
        if (!setup[one][2])
            REG(setup[one][0]) = setup[one][1];
        while (~REG(setup[one][0]) & setup[one][2]);
    }
    board_alive();
    REG(0x40058000) = 1 << 30;
}

bool board_read(uint8_t *byte) {
    if (UART(0x18) & 1 << 4)
        return false;
    *byte = UART(0);
    return true;
}

void board_write(uint8_t byte) {
    while (UART(0x18) & 1 << 5);
    UART(0) = byte;
}

void board_alive(void) { REG(0x40058004) = 2 * 30000; } /* 30 ms: counts down twice a us, erratum E1 */
uint8_t board_buttons(void) { return (SIO(4) & 1 << 5 ? 0 : DEADMAN) | (SIO(4) & 1 << 8 ? 0 : GRIPPER); }
uint16_t board_sense(void) { return REG(0x4004C004); }

void board_drive(bool negative, uint16_t ma) {
    SIO(negative ? 0x14 : 0x18) = 1 << 7;
    REG(0x40050048) = (uint32_t)ma * STEPS / FULL_MA;
}

void board_lamp(bool lit) { SIO(lit ? 0x14 : 0x18) = 1 << 25; }
