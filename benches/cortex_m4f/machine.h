/* What `start.c` offers. */
#ifndef MACHINE_H
#define MACHINE_H

void print(const char *text);
void print_number(long value);
/* Seven digits and an exponent. */
void print_float(float value);
/* Runs something that makes so many calls, and prints the instructions of one (to 40 in all) and the bytes of stack. */
void measure(const char *name, void (*what)(void), long calls);
/* Instructions since the clock was started (to 40, at most 670 million). */
void clock_start(void);
long clock_instructions(void);

#endif
