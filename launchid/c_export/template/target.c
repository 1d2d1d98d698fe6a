/* Cortex-M under QEMU, for `make check-m7` and `check-m4`: the reset, and an update that measures.

   Stack: what an update leaves changed below it.  Instructions: QEMU's clock, which with `-icount shift=6` moves 64 ns
   an instruction, read by SysTick at 25 MHz.  Neither is a bound on time: an emulator knows no cache and no wait state. */

#include "launchid.h"

#include <stdio.h>

#define CPACR (*(volatile uint32_t *)0xE000ED88U)
#define SYSTICK_CONTROL (*(volatile uint32_t *)0xE000E010U)
#define SYSTICK_RELOAD (*(volatile uint32_t *)0xE000E014U)
#define SYSTICK_VALUE (*(volatile uint32_t *)0xE000E018U)
#define TICKS 0x00FFFFFFU
#define TICK_NS 40U
#define INSTRUCTION_NS 64U
#define PAINT 0xA5A5A5A5U
#define PAINTED 8192U   /* words below an update's frame: 32 kB */
#define SPARED 64U      /* words next to this function's own frame */

extern uint32_t __stack;
void _start(void);
void target_reset(void);
static void target_halt(void);
launchid_status measured_update(launchid_estimator *e, const launchid_sample *s);
void measured_report(void);

static uint32_t most_stack, most_ticks, updates;
static uint64_t all_ticks;

__attribute__((section(".vectors"), used)) static void *const vectors[16] = {
    &__stack, (void *)target_reset, (void *)target_halt, (void *)target_halt, (void *)target_halt,
    (void *)target_halt, (void *)target_halt};

static void target_halt(void)
{
    for (;;) {
    }
}

void target_reset(void)
{
    CPACR |= 0xFU << 20;  /* the floating-point unit */
    __asm volatile("dsb\n\tisb");
    SYSTICK_RELOAD = TICKS;
    SYSTICK_VALUE = 0U;
    SYSTICK_CONTROL = 5U;
    _start();
}

__attribute__((noinline)) launchid_status measured_update(launchid_estimator *e, const launchid_sample *s)
{
    uint32_t *const here = __builtin_frame_address(0);
    volatile uint32_t *const top = here - SPARED;
    volatile uint32_t *const bottom = here - PAINTED;
    for (volatile uint32_t *at = bottom; at < top; at++) {
        *at = PAINT;
    }
    const uint32_t begin = SYSTICK_VALUE;
    const launchid_status status = launchid_update(e, s);
    const uint32_t ticks = (begin - SYSTICK_VALUE) & TICKS;
    volatile uint32_t *deepest = bottom;
    while (deepest < top && *deepest == PAINT) {
        deepest++;
    }
    const uint32_t stack = (uint32_t)((const char *)here - (const char *)(uintptr_t)deepest);
    most_stack = stack > most_stack ? stack : most_stack;
    most_ticks = ticks > most_ticks ? ticks : most_ticks;
    all_ticks += ticks;
    updates++;
    return status;
}

void measured_report(void)
{
    printf("an update: stack at most %lu bytes; %lu instructions, longest %lu\n", (unsigned long)most_stack,
           (unsigned long)(all_ticks * TICK_NS / INSTRUCTION_NS / updates),
           (unsigned long)(most_ticks * TICK_NS / INSTRUCTION_NS));
}
