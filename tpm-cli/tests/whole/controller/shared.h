/* What the programs around generated estimators share. */
#include <stdio.h>

/* Reads so many numbers; says whether all were there. */
static int read_numbers(double *numbers, int count)
{
    int i;
    for (i = 0; i < count; ++i) {
        if (scanf("%lf", &numbers[i]) != 1) {
            return 0;
        }
    }
    return 1;
}

/* Sets the members of a structure of so many numbers. */
static void set_numbers(void *members, const double *numbers, int count)
{
    int i;
    for (i = 0; i < count; ++i) {
        ((REAL *)members)[i] = (REAL)numbers[i];
    }
}

/* Prints the status and, where it is zero, every value with its deviation. */
static void print_found(int status, const void *values, const void *deviations, int count)
{
    int i;
    printf("%d\n", status);
    for (i = 0; status == 0 && i < count; ++i) {
        printf("%.17g\n%.17g\n", (double)((const REAL *)values)[i], (double)((const REAL *)deviations)[i]);
    }
}

/* Prints a number where the status is zero. */
static void print_number(int status, REAL number)
{
    if (status == 0) {
        printf("%.17g\n", (double)number);
    }
}
