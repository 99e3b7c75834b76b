/* What `start.c` offers, on a computer. */
#include <stdio.h>

#include "machine.h"

void print(const char *text)
{
    fputs(text, stdout);
}

void print_number(long value)
{
    printf("%ld", value);
}

void print_float(float value)
{
    printf("%.9g", (double)value);
}

void clock_start(void)
{
}

long clock_instructions(void)
{
    return 0;
}

void measure(const char *name, void (*what)(void), long calls)
{
    (void)name;
    (void)calls;
    what();
}
