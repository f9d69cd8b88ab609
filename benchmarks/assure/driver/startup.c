/* The vector table of a Cortex-M, and what must happen before the C library starts. */
extern void _start(void);
extern unsigned char stack_top;
void start(void);
void fault(void);

__attribute__((section(".vectors"), used)) static void (*const vectors[])(void) = {
    (void (*)(void))&stack_top, start, fault, fault, fault, fault, fault};

/* Ends the emulation with an error: semihosting's SYS_EXIT for any other reason. */
void fault(void)
{
    for (;;) {
        __asm volatile("mov r0, #0x18\n ldr r1, =0x20022\n bkpt 0xab" ::: "r0", "r1");
    }
}

void start(void)
{
#if defined(__ARM_FP)
    *(volatile unsigned *)0xE000ED88u |= 0xFu << 20; /* the floating-point unit is off at reset */
    __asm volatile("dsb\n isb");
#endif
    _start();
}
