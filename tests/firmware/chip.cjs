// An emulated chip that runs as far as each line of stdin says: `node chip.cjs handle_avr|hx711_avr|handle_rp2040 IMAGE`.
// Line in: {us, bytes, delay_us, edges, pins, hang, reset, count}; line out: {bytes, duty, late_us}. The bytes come
// after `delay_us`; `edges` of the encoder are spread over the time; `late_us`: the longest from a byte of the host to
// another duty, so far.
const fs = require('fs');
const readline = require('readline');
const kind = process.argv[2], image = fs.readFileSync(process.argv[3]);
const queue = [], sent = [];
let duty = 0, arrived_us = 0, late_us = 0, held_us = 0, hung = null;

function driven(now) {
  if (now !== duty) late_us = Math.max(late_us, chip.now_us() - arrived_us);
  duty = now;
}

function avr() {
  const { CPU, avrInstruction, AVRTimer, timer0Config, timer1Config, AVRUSART, usart0Config, AVRIOPort, portBConfig,
    portDConfig, AVRWatchdog, watchdogConfig, AVRClock, clockConfig } = require('avr8js');
  const HZ = 16e6, program = new Uint16Array(0x4000), bytes = new Uint8Array(program.buffer);
  for (const line of image.toString().split('\n')) {
    const [size, at, type] = [[1, 2], [3, 4], [7, 2]].map(([from, digits]) => parseInt(line.substr(from, digits), 16));
    if (type === 0) bytes.set(Buffer.from(line.substr(9, 2 * size), 'hex'), at);
  }
  let cpu, portB, portD, usart, begun_us = 0, wanted = false;
  const now_us = () => begun_us + cpu.cycles / (HZ / 1e6);
  function power() { // after a reset all is made anew: avr8js resets the core, and not what is around it
    if (cpu) begun_us = now_us();
    if (hung !== null) program[hung[0]] = hung[1];
    [hung, wanted] = [null, false];
    cpu = new CPU(program, 2048);
    [portB, portD] = [new AVRIOPort(cpu, portBConfig), new AVRIOPort(cpu, portDConfig)];
    [new AVRTimer(cpu, timer0Config), new AVRTimer(cpu, timer1Config)];
    new AVRWatchdog(cpu, watchdogConfig, new AVRClock(cpu, HZ, clockConfig));
    usart = new AVRUSART(cpu, usart0Config, HZ);
    usart.onByteTransmit = (byte) => sent.push(byte);
    usart.onRxComplete = () => { arrived_us = now_us(); };
    const hook = cpu.writeHooks[usart0Config.UCSRB]; // avr8js loses a byte that waits at each write of UCSRB
    cpu.writeHooks[usart0Config.UCSRB] = (...written) => {
      const waits = cpu.data[usart0Config.UCSRA] & usart.RXC.flagMask, done = hook(...written);
      if (waits) cpu.setInterruptFlag(usart.RXC);
      return done;
    };
    cpu.reset = () => { wanted = true; };
    if (kind === 'hx711_avr') hx711(portD);
  }
  power();
  return {
    now_us,
    step() {
      if (wanted) power();
      if (queue.length && now_us() >= held_us && usart.writeByte(queue[0]) === true) queue.shift();
      avrInstruction(cpu);
      cpu.tick();
      driven(cpu.data[0x44] & 0x80 ? (cpu.data[0x2b] & 0x20 ? -1 : 1) * cpu.data[0x47] : 0); // TCCR0A, PORTD, OCR0A
    },
    pin: (name, high) => ({ index: portB, deadman: portD, gripper: portD, a: portD, b: portD })[name]
      .setPin({ index: 0, deadman: 4, gripper: 7, a: 2, b: 3 }[name], high),
    hang() {
      hung = [cpu.pc, program[cpu.pc]];
      program[cpu.pc] = 0xcfff; // rjmp to itself
    },
    reset: power,
  };
}

let count = 0; // what the HX711 has measured
function hx711(portD) { // 80 Hz: DOUT (3) falls; each rising edge of PD_SCK (2) shifts a bit out; the 25th ends it
  let clock = false, bit = 0, ready_us = 0;
  portD.addListener((value) => {
    const high = !!(value & 4);
    if (high && !clock && bit < 24) portD.setPin(3, !!((count >> (23 - bit++)) & 1));
    else if (high && !clock) [bit, ready_us] = [0, chip.now_us() + 12500], portD.setPin(3, true);
    clock = high;
  });
  each = () => { if (ready_us !== null && chip.now_us() >= ready_us) { portD.setPin(3, false); ready_us = null; } };
}
let each = () => {};

function rp2040() {
  const { RP2040, ConsoleLogger, LogLevel } = require('rp2040js');
  const mcu = new RP2040(), uart = mcu.uart[0], watchdog = mcu.peripherals[0x40058];
  let wanted = false;
  mcu.logger = new ConsoleLogger(LogLevel.Error);
  uart.onByte = (byte) => sent.push(byte);
  const start = () => { // as the boot ROM does it, from flash in place of RAM
    if (hung !== null) mcu.flash16[hung[0]] = hung[1];
    [hung, wanted] = [null, false];
    mcu.core.reset();
    mcu.pwm.reset();
    mcu.core.SP = 0x20042000;
    mcu.core.PC = 0x10000000;
  };
  mcu.flash.set(image);
  start();
  watchdog.onWatchdogTrigger = () => {
    watchdog.writeUint32(0, 0);
    wanted = true;
  };
  return {
    now_us: () => mcu.clock.micros,
    step() {
      if (wanted) start();
      if (queue.length && chip.now_us() >= held_us && !uart.rxFIFO.full && uart.enabled) {
        uart.feedByte(queue.shift());
        arrived_us = chip.now_us();
      }
      mcu.clock.tick(mcu.core.executeInstruction() * 1e9 / 12e6);
      const ch = mcu.pwm.channels[3];
      driven((mcu.sio.gpioValue & 0x80 ? -1 : 1) * (ch.cc & 0xffff));
    },
    pin: (name, high) => mcu.gpio[{ a: 2, b: 3, index: 4, deadman: 5, gripper: 8 }[name]].setInputValue(high),
    hang() {
      hung = [(mcu.core.PC & 0xffffff) >> 1, mcu.flash16[(mcu.core.PC & 0xffffff) >> 1]];
      mcu.flash16[hung[0]] = 0xe7fe; // b to itself
    },
    reset: start,
  };
}

const chip = kind === 'handle_rp2040' ? rp2040() : avr();
let counts = 0;
readline.createInterface({ input: process.stdin }).on('line', (line) => {
  const { us, bytes = '', delay_us = 0, edges = 0, pins = {}, hang, reset, ...other } = JSON.parse(line);
  queue.push(...Buffer.from(bytes, 'hex'));
  for (const [name, high] of Object.entries(pins)) chip.pin(name, high);
  if (hang) chip.hang();
  if (reset) chip.reset();
  count = other.count ?? count;
  const begun_us = chip.now_us();
  held_us = begun_us + delay_us;
  for (let edge = 1; edge <= Math.abs(edges) + 1; edge++) {
    const until_us = begun_us + us * edge / (Math.abs(edges) + 1);
    while (chip.now_us() < until_us) { each(); chip.step(); }
    if (edge > Math.abs(edges)) break;
    counts += Math.sign(edges);
    const lines = [[0, 0], [1, 0], [1, 1], [0, 1]][((counts % 4) + 4) % 4];
    chip.pin('a', !!lines[0]);
    chip.pin('b', !!lines[1]);
  }
  console.log(JSON.stringify({ bytes: Buffer.from(sent.splice(0)).toString('hex'), duty, late_us }));
});
