/* k2 x1^3 of a chain of carts with FLINT's multivariate polynomials over the integers: `cube CARTS SECONDS` prints the terms
   and the least times in microseconds, of the polynomial and of it with its terms read out. */
#include <flint/fmpz_mpoly.h>
#include <flint/fmpz_vec.h>
#include <stdio.h>
#include <stdlib.h>
#include "least.h"

static long l;
static fmpz_mpoly_ctx_t ctx;

/* Symbols in the order k2, m2.., h1.., x0, x2, .. */
static long mass(long i) { return i - 1; }
static long flexibility(long i) { return l - 1 + i; }
static long motion(long k) { return 2 * l - 1 + k; }

static void work(fmpz_mpoly_t cube) {
    fmpz_mpoly_t x[32], f[32], symbol, term;
    fmpz_mpoly_init(symbol, ctx);
    fmpz_mpoly_init(term, ctx);
    for (long k = 0; k <= l; k++) {
        fmpz_mpoly_init(x[k], ctx);
        fmpz_mpoly_init(f[k], ctx);
    }
    fmpz_mpoly_one(x[0], ctx);
    long n = 1;
    for (long cart = l; cart >= 2; cart--) {
        fmpz_mpoly_gen(symbol, mass(cart), ctx);
        for (long k = 0; k < n; k++) {
            fmpz_mpoly_mul(term, x[k], symbol, ctx);
            fmpz_mpoly_add(f[k + 1], f[k + 1], term, ctx);
        }
        n++;
        fmpz_mpoly_gen(symbol, flexibility(cart - 1), ctx);
        for (long k = 1; k < n; k++) {
            fmpz_mpoly_mul(term, f[k], symbol, ctx);
            fmpz_mpoly_add(x[k], x[k], term, ctx);
        }
    }
    fmpz_mpoly_zero(cube, ctx);
    for (long k = 0; k < n; k++) {
        fmpz_mpoly_gen(symbol, motion(k), ctx);
        fmpz_mpoly_mul(term, x[k], symbol, ctx);
        fmpz_mpoly_add(cube, cube, term, ctx);
    }
    fmpz_mpoly_pow_ui(term, cube, 3, ctx);
    fmpz_mpoly_gen(symbol, 0, ctx);
    fmpz_mpoly_mul(cube, term, symbol, ctx);
    for (long k = 0; k <= l; k++) {
        fmpz_mpoly_clear(x[k], ctx);
        fmpz_mpoly_clear(f[k], ctx);
    }
    fmpz_mpoly_clear(symbol, ctx);
    fmpz_mpoly_clear(term, ctx);
}

static void list(void) {
    long count = 3 * l - 1;
    ulong *e = malloc(sizeof(ulong) * count);
    fmpz_mpoly_t cube;
    fmpz_t c;
    fmpz_mpoly_init(cube, ctx);
    fmpz_init(c);
    work(cube);
    for (long i = 0; i < fmpz_mpoly_length(cube, ctx); i++) {
        fmpz_mpoly_get_term_coeff_fmpz(c, cube, i, ctx);
        fmpz_mpoly_get_term_exp_ui(e, cube, i, ctx);
        fmpz_print(c);
        for (long v = 0; v < count; v++) {
            if (!e[v]) continue;
            if (v == 0) printf(" k2^%lu", e[v]);
            else if (v < l) printf(" m%ld^%lu", v + 1, e[v]);
            else if (v < 2 * l - 1) printf(" h%ld^%lu", v - l + 1, e[v]);
            else printf(" x%ld^%lu", 2 * (v - 2 * l + 1), e[v]);
        }
        printf("\n");
    }
}

/* Every coefficient with its exponents, as a caller needs them. */
static void read_out(const fmpz_mpoly_t cube) {
    long length = fmpz_mpoly_length(cube, ctx), count = 3 * l - 1;
    fmpz *c = _fmpz_vec_init(length);
    ulong *e = malloc(sizeof(ulong) * length * count);
    for (long i = 0; i < length; i++) {
        fmpz_mpoly_get_term_coeff_fmpz(c + i, cube, i, ctx);
        fmpz_mpoly_get_term_exp_ui(e + i * count, cube, i, ctx);
    }
    _fmpz_vec_clear(c, length);
    free(e);
}

static void polynomial(void) {
    fmpz_mpoly_t cube;
    fmpz_mpoly_init(cube, ctx);
    work(cube);
    fmpz_mpoly_clear(cube, ctx);
}

static void whole(void) {
    fmpz_mpoly_t cube;
    fmpz_mpoly_init(cube, ctx);
    work(cube);
    read_out(cube);
    fmpz_mpoly_clear(cube, ctx);
}

int main(int argc, char **argv) {
    if (argc != 3) return 2;
    l = atol(argv[1]);
    if (l < 2 || l > 30) return 2;
    fmpz_mpoly_ctx_init(ctx, 3 * l - 1, ORD_DEGREVLEX);
    list();
    double seconds = atof(argv[2]), alone = least(seconds, polynomial);
    printf("%.3f %.3f\n", alone, least(seconds, whole));
    return 0;
}
