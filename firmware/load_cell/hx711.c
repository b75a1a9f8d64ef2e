/* An HX711 on an ATmega328P at 16 MHz (Arduino Uno, Nano): each conversion is a line of its counts, for the driver
   ascii_line with unit: counts. Pins as printed: 3 DOUT, 2 PD_SCK. Gain 128, channel A; RATE of the HX711 high:
   80 conversions a second. Times: HX711 data sheet, serial interface: PD_SCK high for 0.2 to 50 us. */
#include <avr/io.h>
#include <avr/wdt.h>
#include <stdbool.h>
#include <stdint.h>
#include <util/delay.h>

#define BAUD 500000 /* exact at 16 MHz; a line of ten bytes takes 0.2 ms */
#define BITS 24
#define EXTRA 1 /* pulses behind the bits: channel A, gain 128, for the next conversion */

static bool waits(void) { return !(PIND & 1 << PD3); }

static bool pulse(void) { /* the bit that it shifts out */
    PORTD |= 1 << PD2;
    _delay_us(1);
    bool high = PIND & 1 << PD3;
    PORTD &= ~(1 << PD2);
    _delay_us(1);
    return high;
}

static void print(char byte) {
    while (!(UCSR0A & 1 << UDRE0));
    UDR0 = byte;
}

static void print_line(int32_t counts) {
    char digits[8];
    uint8_t size = 0;
    uint32_t rest = counts < 0 ? -counts : counts;
    do {
        digits[size++] = '0' + rest % 10;
        rest /= 10;
    } while (rest);
    if (counts < 0)
        print('-');
    while (size)
        print(digits[--size]);
    print('\r');
    print('\n');
}

int main(void) {
    wdt_enable(WDTO_2S); /* of a chip that hangs; one without an HX711 starts over and over, and says nothing */
    PORTD = 1 << PD3;    /* a pull-up: with no HX711 nothing waits */
    DDRD = 1 << PD2;
    UBRR0 = F_CPU / 8 / BAUD - 1;
    UCSR0A = 1 << U2X0;
    UCSR0B = 1 << TXEN0;
    for (;;) {
        while (!waits());
        uint32_t read = 0;
        for (uint8_t bit = 0; bit < BITS; bit++)
            read = read << 1 | pulse();
        for (uint8_t bit = 0; bit < EXTRA; bit++)
            pulse();
        if (waits())
            continue; /* high after the last pulse, or it is no HX711 */
        wdt_reset();
        print_line(read & 1UL << (BITS - 1) ? (int32_t)read - (1L << BITS) : (int32_t)read);
    }
}
