/* Counts instructions and stack on a Cortex-M that qemu emulates with `-icount shift=10`.
 *
 * There an instruction takes 1.024 us of virtual time, and SysTick runs at 25 MHz: 25.6 ticks.
 */
#include <stdint.h>

#define SYSTICK ((volatile uint32_t *)0xE000E010u)
#define PAINT 0xA5C3E197u
#define PAINTED 2048

static void start_counting(void)
{
    SYSTICK[1] = 0xFFFFFFu;
    SYSTICK[2] = 0;
    SYSTICK[0] = 5;
}

__attribute__((noinline)) static void paint_stack(uint32_t *pointer)
{
    volatile uint32_t *here = pointer;
    int k;
    for (k = 4; k < PAINTED; k++) {
        here[-k] = PAINT;
    }
}

__attribute__((noinline)) static double stack_used(uint32_t *pointer)
{
    volatile uint32_t *here = pointer;
    int k;
    for (k = PAINTED - 1; k >= 4 && here[-k] == PAINT; k--) {
    }
    return 4.0 * k;
}

/* An instruction lies between the two readings of the timer even where nothing is called. */
#define COUNT(call, results)                                                                \
    do {                                                                                    \
        uint32_t *pointer, before, after;                                                   \
        __asm volatile("mov %0, sp" : "=r"(pointer));                                       \
        paint_stack(pointer);                                                               \
        before = SYSTICK[2];                                                                \
        call;                                                                               \
        after = SYSTICK[2];                                                                 \
        (results)[0] = ((((before - after) & 0xFFFFFFu) * 5u + 64u) / 128u) - 1u;           \
        (results)[1] = stack_used(pointer);                                                 \
    } while (0)
