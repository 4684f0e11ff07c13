// SPDX-License-Identifier: MIT
// An STM32F405RG as on a pyboard v1.1: the core in libunicorn, the peripherals here.
// The sensor is on I2C1 (PB6, PB7) and PB0, PB1, the button on PB3, the wire on USART2
// (PA2, PA3), a card on SPI1 (PA4 to PA7); work on a sample shows on PC6. Where there
// is a radio it sits between USART2 and the wire: its RTS on PA0, its CTS on PA1, PIO2
// on PB12, its reset on PB13. Where there is a battery: half of its voltage on PC0, the
// charger's PGOOD and CHG on PC1, PC2.
//
// Documents: RM = RM0090 (reference manual), PM = PM0214 (programming manual), ARM =
// ARMv7-M architecture reference manual DDI 0403E, DS = STM32F405xx data sheet
// DocID022152; sections by their titles, which all editions share.
//
// Time is in picoseconds since power came. An instruction takes one cycle of the clock
// that the RCC says; what a core waits for flash, for the bus or on the way into an
// exception takes none, so cycles are a lower bound. An interrupt comes before the
// instruction after the one that it falls into.
//
// Not modelled: what is in no table of machine.c. An access to it ends the run.
#ifndef SIM_F405_F405_H
#define SIM_F405_F405_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <unicorn/unicorn.h>

#define F405_NEVER UINT64_MAX
#define F405_PS_PER_US UINT64_C(1000000)
#define F405_PS_PER_S UINT64_C(1000000000000)
#define F405_HSE_HZ 12000000U  // the crystal of the pyboard v1.1
#define F405_HSI_HZ 16000000U
#define F405_LSI_HZ 32000U  // DS, "LSI oscillator characteristics", typical

enum {
    F405_FLASH = 0x08000000,
    F405_FLASH_SIZE = 0x100000,
    F405_RAM = 0x20000000,
    F405_RAM_SIZE = 0x20000,
    F405_CCM = 0x10000000,
    F405_CCM_SIZE = 0x10000,
    F405_SYSTEM = 0x1FFF7000,  // the page with the device's signature
    F405_SYSTEM_SIZE = 0x1000,
    F405_PAINT = 0xA5,  // fills RAM at power-up, to find the deepest stack
    F405_SUPPLY_MV = 3300,
};

// Reset causes, bits of RCC_CSR (RM, "RCC clock control & status register").
enum f405_reset {
    F405_RESET_BROWN_OUT = 1 << 25,
    F405_RESET_PIN = 1 << 26,
    F405_RESET_POWER_ON = 1 << 27,
    F405_RESET_SOFTWARE = 1 << 28,
    F405_RESET_WATCHDOG = 1 << 29,
};

// Exceptions by number: the core's, then the lines of the NVIC from 16 on (RM, "Vector
// table for STM32F405xx/07xx").
enum f405_exception {
    EXCEPTION_NMI = 2,
    EXCEPTION_HARD_FAULT = 3,
    EXCEPTION_MEMORY_FAULT = 4,
    EXCEPTION_BUS_FAULT = 5,
    EXCEPTION_USAGE_FAULT = 6,
    EXCEPTION_SVC = 11,
    EXCEPTION_PENDSV = 14,
    EXCEPTION_SYSTICK = 15,
    EXCEPTION_IRQ = 16,
    IRQ_FLASH = 4,
    IRQ_RCC = 5,
    IRQ_EXTI0 = 6,
    IRQ_DMA1_STREAM0 = 11,
    IRQ_ADC = 18,
    IRQ_EXTI9_5 = 23,
    IRQ_TIM2 = 28,
    IRQ_TIM3 = 29,
    IRQ_TIM4 = 30,
    IRQ_I2C1_EVENT = 31,
    IRQ_I2C1_ERROR = 32,
    IRQ_SPI1 = 35,
    IRQ_USART2 = 38,
    IRQ_EXTI15_10 = 40,
    IRQ_DMA1_STREAM7 = 47,
    IRQ_TIM5 = 50,
    IRQ_DMA2_STREAM0 = 56,
    IRQ_DMA2_STREAM5 = 68,
    IRQ_LINES = 82,
    EXCEPTIONS = EXCEPTION_IRQ + IRQ_LINES,
};

// What happens by itself, each at one moment at most; at the same moment in this order.
enum f405_event {
    EVENT_OSCILLATORS,
    EVENT_CHIP,
    EVENT_FLASH,
    EVENT_IWDG,
    EVENT_SYSTICK,
    EVENT_TIMER2,
    EVENT_TIMER3,
    EVENT_TIMER4,
    EVENT_TIMER5,
    EVENT_I2C,
    EVENT_USART_SENT,
    EVENT_USART_RECEIVED,
    EVENT_USART_IDLE,
    EVENT_SPI,
    EVENT_ADC,
    EVENT_RADIO,
    EVENTS,
};

enum { PORT_A, PORT_B, PORT_C, PORT_D, PORT_H, PORTS };
enum { TIMERS = 4 };  // TIM2 to TIM5
enum { STREAMS = 8 };

// The sensor, whatever it is: the wire as in chips/lsm9ds0.h.
struct f405_chip {
    void *self;
    void (*advance)(void *self, uint64_t now_ns);
    uint64_t (*next_event)(const void *self);
    bool (*holds_sda)(void *self, uint64_t now_ns);
    bool (*start)(void *self, uint64_t now_ns, uint8_t address, bool is_read);
    bool (*write)(void *self, uint64_t now_ns, uint8_t byte);
    uint8_t (*read)(void *self, uint64_t now_ns, bool ack);
    void (*stop)(void *self, uint64_t now_ns);
    void (*scl_pulse)(void *self, uint64_t now_ns);
    void (*power_cycle)(void *self, uint64_t now_ns);
    bool (*data_ready)(const void *self, unsigned pin);  // 0 on PB0, 1 on PB1
};

// What sits in the card's socket: a byte goes out on MOSI while one comes in on MISO.
struct f405_card {
    void *self;
    uint8_t (*exchange)(void *self, uint64_t now_ns, uint32_t clock_hz, uint8_t byte);
    void (*select)(void *self, uint64_t now_ns, bool is_selected);  // PA4
    void (*power_cycle)(void *self, uint64_t now_ns);
};

// A radio with a UART: as in chips/rn41.h, as far as the board's wires go.
struct f405_radio {
    void *self;
    void (*advance)(void *self, uint64_t now_ns);
    uint64_t (*next_event)(const void *self);
    void (*receive)(void *self, uint64_t now_ns, uint8_t byte, uint32_t baud);
    bool (*take)(void *self, uint8_t *byte, uint32_t *baud);
    bool (*is_sending)(const void *self);
    void (*set_cts)(void *self, uint64_t now_ns, bool is_high);
    void (*set_reset)(void *self, uint64_t now_ns, bool is_low);
    int (*rts)(const void *self);
    int (*pio2)(const void *self);
    void (*host_write)(void *self, uint64_t now_ns, uint8_t byte);
    void (*power_cycle)(void *self, uint64_t now_ns);
};

// What instructions work on. `rest` is XPSR without N, Z, C, V and the IT state.
struct f405_registers {
    uint32_t r[15];  // R0 to LR
    bool n, z, c, v;
    uint8_t it;
    uint32_t rest, primask, faultmask, basepri, control, fpscr;
    uint32_t s[32];
};

struct f405_core {
    bool pending[EXCEPTIONS], active[EXCEPTIONS], enabled[EXCEPTIONS];
    bool level[EXCEPTIONS];  // what asks for it still asks
    uint8_t priority[EXCEPTIONS];
    uint32_t vtor, aircr, scr, ccr, shcsr, cfsr, hfsr, dfsr, mmfar, bfar, cpacr;
    uint32_t fpccr, fpcar, fpdscr, demcr, dwt_control, debug;
    uint64_t cycles_at;  // awake cycle at which DWT_CYCCNT was 0
    bool counts_cycles;
    uint32_t cycles_held;
    // SysTick
    uint32_t tick_control, tick_load, tick_held;
    uint64_t tick_from;  // when it was tick_held
    bool has_event;      // the event register, for WFE
};

struct f405_rcc {
    uint32_t cr, pllcfgr, cfgr, cir;
    uint32_t rstr[6], enr[6], lpenr[6];  // AHB1 AHB2 AHB3, a gap, APB1 APB2
    uint32_t bdcr, csr, sscgr, plli2scfgr;
    uint64_t hse_at, hsi_at, pll_at, lsi_at;  // ready then
    bool is_crystal_dead;
    uint32_t pwr_cr, pwr_csr;
    // In STOP mode; since, and what was under way with how much of its time left.
    bool is_stopped;
    uint64_t stopped_at, left[EVENTS];
};

struct f405_flash {
    uint32_t acr, sr, cr, optcr;
    unsigned keys;  // taken so far
    bool is_key_wrong;
    bool is_busy, is_erase;
    uint32_t from, size;  // of what is under way: offset, bytes
    uint32_t value, before;
    uint64_t began, busy_until;
    uint64_t writes;
    // Stores that libunicorn is about to make, and what shall stand there instead.
    struct {
        uint32_t offset, size, value;
    } stores[16];
    unsigned store_count;
    bool has_stored;  // since libunicorn last looked up what it may write
};

struct f405_port {
    uint32_t moder, otyper, ospeedr, pupdr, odr, afr[2];
    uint16_t levels;  // as last seen by edge detectors
};

struct f405_exti {
    uint32_t imr, emr, rtsr, ftsr, pr;
    uint32_t exticr[4], memrmp, pmc;
};

struct f405_timer {
    uint32_t cr1, cr2, dier, sr, ccmr[2], ccer, psc, arr, ccr[4], option;
    uint32_t shadow_psc, shadow_arr;
    uint64_t from;  // when the count was `count`
    uint32_t count;
    uint64_t seen;  // ticks since `from` whose matches are in sr
};

struct f405_stream {
    uint32_t cr, ndtr, par, m0ar, m1ar, fcr;
    uint32_t length, at, register_at;  // as when enabled; where it stands
};

struct f405_dma {
    struct f405_stream streams[STREAMS];
    uint8_t flags[STREAMS];  // as in LISR: FEIF, DMEIF, TEIF, HTIF, TCIF
};

struct f405_i2c {
    uint32_t cr1, cr2, oar1, oar2, sr1, sr2, ccr, trise, fltr;
    uint8_t data, shift;
    bool is_data_full;   // to be sent
    bool is_shift_full;  // received, and the data register still full
    enum { BUS_IDLE, BUS_START, BUS_ADDRESS, BUS_SEND, BUS_RECEIVE, BUS_STOP } doing;
    bool is_reading;
    bool acks_next;   // what POS has said of the byte under way
    bool is_busy;     // seen so on the bus, until a STOP or a reset
    bool is_refused;  // the other side has not acknowledged
    bool had_ack;     // that we gave, of the last byte received
    uint32_t seen;    // flags that the last read of SR1 showed
    // The lines when the firmware works them as pins.
    bool scl_was_high, sda_was_high;
};

struct f405_usart {
    uint32_t sr, brr, cr1, cr2, cr3, gtpr;
    uint8_t data, shift, received;
    bool is_shifting, is_preamble, is_data_full;
    uint32_t seen;
    bool is_idle_due;  // something has come since the line was last seen idle
    uint64_t overruns, deaf;
    bool was_cts_high;
    uint64_t busy_until;  // receiving, with a frame of another rate
    // What is on its way in: bytes, each with the time before which it doesn't start.
    uint8_t *line;
    uint64_t *line_from;
    size_t line_head, line_count, line_room;
    bool is_receiving;
};

struct f405_spi {
    uint32_t cr1, cr2, sr, crcpr;
    uint16_t data, shift, received;
    bool is_shifting, is_data_full;
    bool has_read_data;  // first half of clearing OVR
};

struct f405_adc {
    uint32_t sr, cr1, cr2, smpr[2], sqr[3], data, ccr;
    unsigned index;  // in the sequence
    bool is_converting;
    double sampled_mv;  // on the sampling capacitor, by the last conversion
};

// What is wired to the pins beside the sensor and the card.
struct f405_wired {
    bool is_cts_high, is_reset_low;  // as the radio has them
    int rts, pio2;                   // as the pins have them
    bool has_battery, is_external, is_charging;
    uint32_t from_mv, to_mv;  // a line in time
    uint64_t from_ps, for_ps;
    double pin_mv;  // of PC0 where nothing holds it
};

struct f405_iwdg {
    uint32_t prescaler, reload;
    bool is_open, is_running;
    uint64_t changed_until;
};

// Who follows the core, instruction by instruction; addresses of bytes. All null: it is
// not watched.
struct f405_watch {
    void *context;
    void (*on_instruction)(void *context, uint32_t at, uint32_t next);
    void (*on_enter)(void *context, uint32_t from, uint32_t handler);
    void (*on_leave)(void *context);
};

struct f405_stack {
    uint32_t top, lowest;  // addresses: first above it, first that may be its own
    uint32_t deepest;      // bytes
};

struct f405 {
    uc_engine *uc;
    uint8_t *flash, *ram, *ccm, *system;
    const struct f405_chip *chip;
    const struct f405_card *card;    // null: none in the socket
    const struct f405_radio *radio;  // null: the wire itself
    uint64_t seed;

    // To the owner; each may be null.
    void *context;
    void (*on_byte)(void *context, uint8_t byte);
    void (*on_mark)(void *context, bool is_begin);  // PC6
    void (*on_data_ready)(void *context);           // PB0 rises
    void (*on_bus)(void *context, bool is_start);   // I2C1: START; all is through
    void (*on_flash_write)(void *context, uint64_t number);
    void (*on_reset)(void *context);

    struct f405_watch watch;

    // Time. Cycles are of the core's clock, asleep or not, at whatever rate.
    uint64_t cycle, base_cycle, base_ps;
    uint32_t hclk_hz;  // 0: the clock has stopped
    uint32_t pclk_hz[2], timer_hz;
    uint64_t until, next_ps, limit_cycle;
    uint64_t when;  // of the event that is being served; NEVER: none is
    uint64_t at[EVENTS];
    uint64_t clock_start;  // when TIM2 or TIM5 was first started, or NEVER
    uint64_t asleep;       // ps
    uint64_t asleep_cycles;
    uint64_t stopped;  // ps of it in STOP mode
    uint64_t resets;

    // The core, between instructions and on its way into the next.
    uint32_t pc;
    struct f405_registers registers;
    struct f405_registers lent;  // as libunicorn has them
    bool is_lent;                // it works on its own
    bool has_stepped;            // by the one instruction that it is asked for
    unsigned attention;          // instructions until somebody wants it to stop; 0 none
    bool is_stopped, is_in_code, is_pumping;
    bool is_blocked;  // an exception waits for a mask to fall
    bool is_asleep, is_locked_up;
    bool is_waiting;  // a WFE is to be served; then: asleep by one
    bool is_deep;     // asleep with SLEEPDEEP
    int trap;         // what Unicorn says of an exception, -1 none
    enum { FAULT_NONE, FAULT_LOAD, FAULT_STORE, FAULT_NO_FPU, FAULT_DIVISION } fault;
    uint32_t fault_address, fault_pc;
    uint32_t wants_reset;  // enum f405_reset

    const char *ended;  // why the run is over
    char ended_text[160];
    const char *complaint;  // the first thing the firmware did against the manuals

    struct f405_core core;
    struct f405_rcc rcc;
    struct f405_flash flash_control;
    struct f405_port ports[PORTS];
    bool is_button_down;
    struct f405_exti exti;
    struct f405_timer timers[TIMERS];
    struct f405_dma dma[2];
    struct f405_i2c i2c;
    struct f405_usart usart;
    struct f405_spi spi;
    struct f405_adc adc;
    struct f405_iwdg iwdg;
    struct f405_wired wired;
    struct f405_stack stack;
};

// Power comes, with flash as it is in m->flash once f405_load() has been called. False
// where libunicorn can't have it. The chip is the caller's.
bool f405_init(struct f405 *m, const struct f405_chip *chip, uint64_t seed);
// Flashes an image: an ELF file for the STM32F405, as the linker left it. Sectors that
// it does not touch stay as they are. False where it is no such image. Sizes in bytes:
// code and first values; variables.
bool f405_load(struct f405 *m, const char *path, uint32_t *flash, uint32_t *ram);
void f405_free(struct f405 *m);
// Starts from the vector table in flash.
void f405_power_up(struct f405 *m);

// Runs until that time. False once it can't go on: m->ended says why.
bool f405_run(struct f405 *m, uint64_t until_ps);
// From a callback: stop at that time at the latest.
void f405_pause(struct f405 *m, uint64_t at_ps);
void f405_reset(struct f405 *m, uint32_t cause);
uint64_t f405_now(const struct f405 *m);
// The same, but within an event the moment for which it was set: the core may be an
// instruction further.
uint64_t f405_when(const struct f405 *m);
uint64_t f405_ns(uint64_t ps);
// Time in STOP mode so far.
uint64_t f405_stopped(const struct f405 *m);
// Puts a byte on the wire to the USART, not before that time.
bool f405_send(struct f405 *m, uint64_t from_ps, uint8_t byte);
void f405_press(struct f405 *m, bool is_down);
// A cell on the board's divider, its voltage on a straight line from now on; then
// stays.
void f405_battery(struct f405 *m, uint32_t from_mv, uint32_t to_mv, uint64_t for_ps);
void f405_charger(struct f405 *m, bool is_external, bool is_charging);
// The crystal dies. SDA is pulled for a moment within the byte under way.
void f405_kill_crystal(struct f405 *m);
void f405_glitch(struct f405 *m);
// Flash as a power cut now would leave it.
void f405_cut_flash(struct f405 *m);
// Deepest stack so far, bytes.
uint32_t f405_stack_deepest(struct f405 *m);
uint32_t f405_sp(const struct f405 *m);

// Between the parts of the machine.
void f405_complain(struct f405 *m, const char *what);
void f405_end(struct f405 *m, const char *format, ...)
    __attribute__((format(printf, 2, 3)));
void f405_not_modelled(struct f405 *m, const char *what);
uint32_t f405_random(struct f405 *m);
uint64_t f405_cycle_at(const struct f405 *m, uint64_t ps);
// n cycles of a clock of so many hertz.
uint64_t f405_ps(uint64_t cycles, uint32_t hz);
void f405_at(struct f405 *m, enum f405_event event, uint64_t ps);
void f405_never(struct f405 *m, enum f405_event event);
void f405_attend(struct f405 *m);
// A host's address of so many bytes of RAM, CCM or flash. Null: it is none of them.
uint8_t *f405_memory(struct f405 *m, uint32_t address, uint32_t size);
bool f405_is_flash(uint32_t address);
bool f405_is_clocked(const struct f405 *m, unsigned bus, unsigned bit);
// As the core does it; false where nothing answers.
bool f405_bus_read(struct f405 *m, uint32_t address, unsigned size, uint32_t *value);
bool f405_bus_write(struct f405 *m, uint32_t address, unsigned size, uint32_t value);
// Lets DMA serve whoever asks.
void f405_pump(struct f405 *m);
uint32_t f405_get(const struct f405 *m, int reg);
void f405_set(struct f405 *m, int reg, uint32_t value);

// Runs instructions from m->pc on, with the same hook before each of them: until
// something is due, WFI, the end of a handler, or one that only libunicorn knows.
enum thumb { THUMB_STOPPED, THUMB_UNKNOWN, THUMB_ASLEEP, THUMB_RETURNS };
enum thumb thumb_run(struct f405 *m);
// The state of an IT block after one of its instructions.
uint8_t thumb_advance(uint8_t it);

// The core: exceptions, NVIC, SCB, SysTick.
void core_reset(struct f405 *m);
void core_irq(struct f405 *m, unsigned exception, bool level);
void core_pend(struct f405 *m, unsigned exception);
// Enters the exception that is due, if one is. True where it did.
bool core_take(struct f405 *m);
// Whether one waits that ends the core's sleep; whether one ever can.
bool core_wakes(const struct f405 *m);
bool core_can_wake(const struct f405 *m);
// After WFI, WFE or on the way out of the last handler. False: it goes on at once.
bool core_sleep(struct f405 *m);
void core_return(struct f405 *m, uint32_t exc_return);
void core_fault(struct f405 *m, unsigned exception, uint32_t status);
void core_service_call(struct f405 *m);
void core_clock_changes(struct f405 *m, bool is_before);
void core_tick(struct f405 *m);
uint32_t core_read(struct f405 *m, unsigned unit, uint32_t at);
void core_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);

void rcc_power_up(struct f405 *m);
void rcc_reset(struct f405 *m, uint32_t cause);
void rcc_event(struct f405 *m);
void rcc_set_clocks(struct f405 *m);
// Into STOP mode and out of it.
void rcc_stop(struct f405 *m, bool is_begin);
uint32_t rcc_read(struct f405 *m, unsigned unit, uint32_t at);
void rcc_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);
uint32_t pwr_read(struct f405 *m, unsigned unit, uint32_t at);
void pwr_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);

void flash_reset(struct f405 *m);
void flash_event(struct f405 *m);
// A store to the flash's own addresses; then, once libunicorn has made it, what it has
// really done.
void flash_store(struct f405 *m, uint32_t address, unsigned size, uint32_t value);
void flash_settle(struct f405 *m);
uint32_t flash_read(struct f405 *m, unsigned unit, uint32_t at);
void flash_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);

void pins_reset(struct f405 *m, unsigned port);
// Something outside or inside that drives pins has changed.
void pins_follow(struct f405 *m);
void pins_follow_port(struct f405 *m, unsigned port);
bool pins_level(const struct f405 *m, unsigned port, unsigned pin);
// Whether the pin is in that alternate function.
bool pins_is_alternate(const struct f405 *m, unsigned port, unsigned pin, unsigned af);
uint32_t pins_read(struct f405 *m, unsigned unit, uint32_t at);
void pins_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);
// Whether an edge can end STOP mode.
bool exti_can_wake(const struct f405 *m);
void exti_reset(struct f405 *m);
uint32_t exti_read(struct f405 *m, unsigned unit, uint32_t at);
void exti_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);
void syscfg_reset(struct f405 *m);
uint32_t syscfg_read(struct f405 *m, unsigned unit, uint32_t at);
void syscfg_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);

void timer_reset(struct f405 *m, unsigned unit);
void timer_event(struct f405 *m, unsigned unit);
void timer_clock_changes(struct f405 *m, bool is_before);
void timer_edge(struct f405 *m, unsigned port, unsigned pin, bool is_high);
uint32_t timer_read(struct f405 *m, unsigned unit, uint32_t at);
void timer_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);

void dma_reset(struct f405 *m, unsigned unit);
// One transfer for a peripheral that asks on that stream and channel. False: nobody is
// set up for it.
bool dma_serve(struct f405 *m, unsigned unit, unsigned stream, unsigned channel,
               bool is_to_peripheral);
// Transfers left of the stream that serves this channel; 0: none does.
uint32_t dma_left(const struct f405 *m, unsigned unit, unsigned stream,
                  unsigned channel);
uint32_t dma_read(struct f405 *m, unsigned unit, uint32_t at);
void dma_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);

void i2c_reset(struct f405 *m, unsigned unit);
void i2c_event(struct f405 *m);
void i2c_follow_pins(struct f405 *m);
bool i2c_pump(struct f405 *m);
// Whether the chip holds SDA low.
bool i2c_is_held(const struct f405 *m);
uint32_t i2c_read(struct f405 *m, unsigned unit, uint32_t at);
void i2c_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);

void usart_reset(struct f405 *m, unsigned unit);
void usart_sent(struct f405 *m);
void usart_received(struct f405 *m);
void usart_idle(struct f405 *m);
bool usart_pump(struct f405 *m);
// The level of RTS, -1 where the pin is not it. CTS may have changed.
int usart_rts(const struct f405 *m);
void usart_follow_cts(struct f405 *m);
// A frame of the radio has ended.
void usart_deliver(struct f405 *m, uint8_t byte, uint32_t baud);
void usart_free(struct f405 *m);
uint32_t usart_read(struct f405 *m, unsigned unit, uint32_t at);
void usart_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);

void spi_reset(struct f405 *m, unsigned unit);
void spi_event(struct f405 *m);
bool spi_pump(struct f405 *m);
uint32_t spi_read(struct f405 *m, unsigned unit, uint32_t at);
void spi_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);

void adc_reset(struct f405 *m, unsigned unit);
void adc_event(struct f405 *m);
bool adc_pump(struct f405 *m);
uint32_t adc_read(struct f405 *m, unsigned unit, uint32_t at);
void adc_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);

void wired_power_up(struct f405 *m);
void wired_event(struct f405 *m);
// What the firmware or time has changed on the wires.
void wired_follow(struct f405 *m);
// What they drive: 0, 1, or -1 for nothing.
int wired_level(const struct f405 *m, unsigned port, unsigned pin);
// PC0 has been set up anew. Its voltage, behind how many ohms; 0: nothing drives it.
void wired_settle(struct f405 *m);
double wired_analog_mv(const struct f405 *m, double *ohms);

void iwdg_reset(struct f405 *m, unsigned unit);
void iwdg_event(struct f405 *m);
uint32_t iwdg_read(struct f405 *m, unsigned unit, uint32_t at);
void iwdg_write(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);

#endif
