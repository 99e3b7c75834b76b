/* Vector table, FPU, semihosting: all that a program on the machine mps2-an386 of QEMU needs. */
#include <stddef.h>
#include <stdint.h>

#include "machine.h"

extern uint32_t stack_top;
extern uint32_t data_start, data_end, data_load, bss_start, bss_end, end;

int main(void);

static long semihost(int operation, const void *argument)
{
    register long r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

void print(const char *text)
{
    semihost(0x04, text);
}

/* A number, without so many of its first characters. */
static void print_without(long value, size_t first)
{
    char text[16];
    size_t at = sizeof text;
    unsigned long size = value < 0 ? 0UL - (unsigned long)value : (unsigned long)value;

    text[--at] = '\0';
    do {
        text[--at] = (char)('0' + size % 10);
        size /= 10;
    } while (size > 0);
    if (value < 0) {
        text[--at] = '-';
    }
    print(&text[at + first]);
}

void print_number(long value)
{
    print_without(value, 0);
}

void print_float(float value)
{
    double size = value < 0.0f ? -(double)value : (double)value;
    long digits, exponent = 0;

    if (!(size <= 3.5e38)) {
        print("not finite");
        return;
    }
    while (size >= 10.0) {
        size /= 10.0;
        ++exponent;
    }
    while (size > 0.0 && size < 1.0) {
        size *= 10.0;
        --exponent;
    }
    if (value < 0.0f) {
        print("-");
    }
    /* A leading one keeps the zeros behind the point. */
    digits = (long)(size * 1e6 + 0.5);
    print_number(digits / 1000000);
    print(".");
    print_without(digits % 1000000 + 1000000, 1);
    print("e");
    print_number(exponent);
}

/* SysTick at 25 MHz: with `-icount shift=0` an instruction takes 1 ns, a tick 40 of them. */
#define SYST_CSR (*(volatile uint32_t *)0xe000e010)
#define SYST_RVR (*(volatile uint32_t *)0xe000e014)
#define SYST_CVR (*(volatile uint32_t *)0xe000e018)

void clock_start(void)
{
    SYST_RVR = 0xffffff;
    SYST_CVR = 0;
    SYST_CSR = 5;
}

long clock_instructions(void)
{
    return (long)(0xffffff - SYST_CVR) * 40;
}

#define PAINT 0xa5a5a5a5U

static void paint(void)
{
    uint32_t *word = &end;
    uint32_t *const here = __builtin_frame_address(0);

    while (word < here - 8) {
        *word++ = PAINT;
    }
}

/* Bytes of the stack that were in use since the last painting. */
static long used(void)
{
    const uint32_t *word = &end;

    while (*word == PAINT) {
        ++word;
    }
    return 4 * (long)((uint32_t *)__builtin_frame_address(0) - word);
}

void measure(const char *name, void (*what)(void), long calls)
{
    long instructions, stack;

    paint();
    clock_start();
    what();
    instructions = clock_instructions();
    stack = used();
    print(name);
    print(": ");
    print_number((instructions + calls / 2) / calls);
    print(" instructions, ");
    print_number(stack);
    print(" bytes of stack\n");
}

void _exit(int status)
{
    /* ADP_Stopped_ApplicationExit or ADP_Stopped_RunTimeError. */
    semihost(0x18, (const void *)(status == 0 ? 0x20026L : 0x20023L));
    for (;;) {
    }
}

void reset(void)
{
    uint32_t *from = &data_load;
    uint32_t *to;

    *(volatile uint32_t *)0xe000ed88 |= 0xfU << 20; /* full access to the FPU */
    __asm__ volatile("dsb\n\tisb");
    for (to = &data_start; to < &data_end; ++to) {
        *to = *from++;
    }
    for (to = &bss_start; to < &bss_end; ++to) {
        *to = 0;
    }
    _exit(main());
}

static void fault(void)
{
    print("fault\n");
    _exit(1);
}

__attribute__((section(".vectors"), used)) static void *const vectors[] = {
    &stack_top, reset, fault, fault, fault, fault, fault,
};
