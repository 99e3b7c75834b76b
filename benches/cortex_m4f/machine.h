/* What `start.c` offers. */
#ifndef MACHINE_H
#define MACHINE_H

void print(const char *text);
void print_number(long value);
void clock_start(void);
/* Instructions since the start, to 40. */
long clock_instructions(void);

#endif
