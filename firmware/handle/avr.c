/* ATmega328P at 16 MHz: Arduino Uno, Nano. Pins as printed: 2, 3 encoder A, B; 8 index; 4 deadman and 7 gripper,
   switches to ground; 6 PWM of 62.5 kHz, 256 steps; 5 direction; 13 lamp; A0 current. */
#include "handle.h"
#include <avr/interrupt.h>
#include <avr/wdt.h>

#define ROOM 128 /* bytes of a ring: a power of two */
#define LISTEN (1 << RXEN0 | 1 << TXEN0 | 1 << RXCIE0)
static volatile uint8_t from_host[ROOM], to_host[ROOM], from_in, from_out, to_in, to_out;

void board_start(void) {
    PORTD = 1 << PD2 | 1 << PD3 | 1 << PD4 | 1 << PD7; /* pull-ups */
    PORTB = 1 << PB0;
    DDRD = 1 << PD5 | 1 << PD6;
    DDRB = 1 << PB5;
    TCCR0A = 1 << WGM01 | 1 << WGM00;
    TCCR0B = 1 << CS00;
    TCCR1B = 1 << WGM12 | 1 << CS11;
    OCR1A = F_CPU / 8 * PERIOD_US / 1000000 - 1;
    TIMSK1 = 1 << OCIE1A;
    UBRR0 = F_CPU / 8 / BAUD - 1;
    UCSR0A = 1 << U2X0;
    UCSR0B = LISTEN;
    EICRA = 1 << ISC00 | 1 << ISC10; /* both edges */
    EIMSK = 1 << INT0 | 1 << INT1;
    PCMSK0 = INDEX << PCINT0;
    PCICR = 1 << PCIE0;
    ADMUX = 1 << REFS0;
    ADCSRA = 1 << ADEN | 1 << ADSC | 1 << ADATE | 7 << ADPS0;
    wdt_enable(WDTO_30MS); /* after a reset by it, it runs on at 15 ms up to here */
    sei();
}

ISR(TIMER1_COMPA_vect) { handle_tick(); }
ISR(INT0_vect) { handle_edge(PIND >> PD2 & 3); }
ISR(INT1_vect, ISR_ALIASOF(INT0_vect));
ISR(PCINT0_vect) { handle_index(PINB & 1 << PB0); }
ISR(USART_RX_vect) { from_host[from_in++ % ROOM] = UDR0; }
ISR(USART_UDRE_vect) {
    UDR0 = to_host[to_out++ % ROOM];
    if (to_in == to_out)
        UCSR0B = LISTEN;
}

bool board_read(uint8_t *byte) {
    if (from_in == from_out)
        return false;
    *byte = from_host[from_out++ % ROOM];
    return true;
}

void board_write(uint8_t byte) {
    while ((uint8_t)(to_in - to_out) == ROOM);
    to_host[to_in % ROOM] = byte;
    cli(); /* or its interrupt comes in between, and once more for nothing */
    to_in++;
    UCSR0B = LISTEN | 1 << UDRIE0;
    sei();
}

void board_alive(void) { wdt_reset(); }
uint8_t board_buttons(void) { return (PIND & 1 << PD4 ? 0 : DEADMAN) | (PIND & 1 << PD7 ? 0 : GRIPPER); }
uint16_t board_sense(void) { return ADC; }

void board_drive(bool negative, uint16_t ma) {
    PORTD = (PORTD & ~(1 << PD5)) | negative << PD5;
    OCR0A = ma * 255UL / FULL_MA;
    TCCR0A = (ma ? 1 << COM0A1 : 0) | 1 << WGM01 | 1 << WGM00; /* off: at 0 there is a spike each period */
}

void board_lamp(bool lit) { PORTB = lit << PB5 | 1 << PB0; }
