/* The expansion with FLINT from C: numerators as fmpz polynomials over denominators that multiply along, each coefficient
   brought to lowest terms at the end. Reads a program as peers.py writes it. */
#include <flint/fmpq.h>
#include <flint/fmpz_poly.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "least.h"

typedef struct { long node; fmpq_t factor; } part;
typedef struct { long count; part *parts; } group;

static long step, n_bases, n_nodes, n_groups, *highest, *parent, *base_of, *span;
static fmpq **dense;
static long *dense_len;
static group *groups;

static long number(FILE *f) { long v; if (fscanf(f, "%ld", &v) != 1) exit(2); return v; }
static void rational(FILE *f, fmpq_t q) {
    char a[4096], b[4096];
    if (fscanf(f, "%4095s %4095s", a, b) != 2) exit(2);
    fmpz_set_str(fmpq_numref(q), a, 10);
    fmpz_set_str(fmpq_denref(q), b, 10);
    fmpq_canonicalise(q);
}

static void load(const char *name) {
    FILE *f = fopen(name, "r");
    if (!f) exit(2);
    step = number(f);
    n_bases = number(f);
    highest = malloc(sizeof(long) * n_bases);
    dense = malloc(sizeof(fmpq *) * n_bases);
    dense_len = malloc(sizeof(long) * n_bases);
    for (long b = 0; b < n_bases; b++) {
        highest[b] = number(f);
        long len = number(f);
        dense[b] = _fmpq_vec_init(len);
        dense_len[b] = len;
        for (long i = 0; i < len; i++) rational(f, dense[b] + i);
    }
    n_nodes = number(f);
    parent = calloc(n_nodes, sizeof(long));
    base_of = calloc(n_nodes, sizeof(long));
    span = calloc(n_nodes, sizeof(long));
    for (long i = 1; i < n_nodes; i++) {
        parent[i] = number(f);
        base_of[i] = number(f);
        span[i] = span[parent[i]] + highest[base_of[i]];
    }
    n_groups = number(f);
    groups = malloc(sizeof(group) * n_groups);
    for (long g = 0; g < n_groups; g++) {
        groups[g].count = number(f);
        groups[g].parts = malloc(sizeof(part) * groups[g].count);
        for (long i = 0; i < groups[g].count; i++) {
            groups[g].parts[i].node = number(f);
            fmpq_init(groups[g].parts[i].factor);
            rational(f, groups[g].parts[i].factor);
        }
    }
    fclose(f);
}

/* A base over its common denominator. */
static void set_base(fmpz_poly_t poly, fmpz_t den, long b) {
    fmpz_t v;
    fmpz_init(v);
    fmpz_one(den);
    for (long i = 0; i < dense_len[b]; i++) fmpz_lcm(den, den, fmpq_denref(dense[b] + i));
    for (long i = 0; i < dense_len[b]; i++) {
        fmpz_divexact(v, den, fmpq_denref(dense[b] + i));
        fmpz_mul(v, v, fmpq_numref(dense[b] + i));
        fmpz_poly_set_coeff_fmpz(poly, i, v);
    }
    fmpz_clear(v);
}

static void work(int list) {
    fmpz_poly_t *bases = malloc(sizeof(fmpz_poly_t) * n_bases);
    fmpz *base_den = _fmpz_vec_init(n_bases);
    for (long b = 0; b < n_bases; b++) {
        fmpz_poly_init2(bases[b], dense_len[b]);
        set_base(bases[b], base_den + b, b);
    }
    fmpz_poly_t *values = malloc(sizeof(fmpz_poly_t) * n_nodes);
    fmpz *den = _fmpz_vec_init(n_nodes);
    fmpz_poly_init(values[0]);
    fmpz_poly_set_ui(values[0], 1);
    fmpz_one(den);
    for (long i = 1; i < n_nodes; i++) {
        fmpz_poly_init(values[i]);
        fmpz_poly_mul(values[i], values[parent[i]], bases[base_of[i]]);
        fmpz_mul(den + i, den + parent[i], base_den + base_of[i]);
    }
    fmpq **table = malloc(sizeof(fmpq *) * n_groups);
    long *lengths = malloc(sizeof(long) * n_groups);
    fmpz_poly_t total, term;
    fmpz_t below, own, scale;
    fmpz_poly_init(total); fmpz_poly_init(term);
    fmpz_init(below); fmpz_init(own); fmpz_init(scale);
    for (long g = 0; g < n_groups; g++) {
        part *parts = groups[g].parts;
        long top = 0;
        const fmpz_poly_struct *sum = total;
        if (groups[g].count == 1 && fmpq_is_one(parts[0].factor)) {
            sum = values[parts[0].node];
            top = span[parts[0].node];
            fmpz_set(below, den + parts[0].node);
        } else {
            fmpz_one(below);
            for (long i = 0; i < groups[g].count; i++) {
                if (span[parts[i].node] > top) top = span[parts[i].node];
                fmpz_mul(own, den + parts[i].node, fmpq_denref(parts[i].factor));
                fmpz_lcm(below, below, own);
            }
            fmpz_poly_zero(total);
            for (long i = 0; i < groups[g].count; i++) {
                fmpz_mul(own, den + parts[i].node, fmpq_denref(parts[i].factor));
                fmpz_divexact(scale, below, own);
                fmpz_mul(scale, scale, fmpq_numref(parts[i].factor));
                fmpz_poly_scalar_mul_fmpz(term, values[parts[i].node], scale);
                if (top != span[parts[i].node]) fmpz_poly_shift_left(term, term, (top - span[parts[i].node]) / step);
                fmpz_poly_add(total, total, term);
            }
        }
        long first = (top + step - 1) / step, len = fmpz_poly_length(sum) - first;
        lengths[g] = len > 0 ? len : 0;
        table[g] = _fmpq_vec_init(lengths[g]);
        for (long i = 0; i < lengths[g]; i++) {
            long k = step * (first + i) - top;
            fmpz *c = sum->coeffs + first + i;
            if (fmpz_is_zero(c)) continue;
            if (k > 0) fmpz_mul_2exp(fmpq_numref(table[g] + i), c, 1);
            else fmpz_set(fmpq_numref(table[g] + i), c);
            fmpz_set(fmpq_denref(table[g] + i), below);
            fmpq_canonicalise(table[g] + i);
            if (list) {
                printf("%ld %ld ", g, k);
                fmpq_print(table[g] + i);
                printf("\n");
            }
        }
    }
    for (long g = 0; g < n_groups; g++) _fmpq_vec_clear(table[g], lengths[g]);
    for (long i = 0; i < n_nodes; i++) fmpz_poly_clear(values[i]);
    _fmpz_vec_clear(den, n_nodes);
    for (long b = 0; b < n_bases; b++) fmpz_poly_clear(bases[b]);
    _fmpz_vec_clear(base_den, n_bases);
    free(bases);
    fmpz_poly_clear(total); fmpz_poly_clear(term);
    fmpz_clear(below); fmpz_clear(own); fmpz_clear(scale);
    free(table); free(lengths); free(values);
}

static void table(void) { work(0); }

int main(int argc, char **argv) {
    if (argc < 3) return 2;
    load(argv[1]);
    if (!strcmp(argv[2], "list")) { work(1); return 0; }
    printf("%.3f\n", least(atof(argv[3]), table));
    return 0;
}
