/* The QR by doubling against the basis itself, row by row in extended precision: with M = [Phi D]
 * and Z = Q^T y, R^T Z = M^T y, R^T R = M^T M and |y|^2 = |Z|^2 + rest.  Tolerances: rounding of L
 * sums and of phases up to pi L, relative to the norms of what is multiplied. */
/* Tests as well: compressed.c */
#include "modal/identify/fit/doubling.h"
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include "check.h"
#include "signals.h"

enum { POLES = 7, COLUMNS_MOST = 4 * POLES };

struct basis {
    int count, order;
    enum pole_kind kind[POLES];
    int column[POLES];
    double a[POLES], b[POLES];
};

static void add(struct basis *p, enum pole_kind kind, double a, double b)
{
    int j = p->count++;

    p->kind[j] = kind, p->a[j] = a, p->b[j] = b;
    p->column[j] = p->order;
    p->order += kind == POLE_PAIR ? 2 : 1;
}

/* A close pair, a fast decay, growth to 1e9, a constant, alternating signs, and one gone after a
 * sample. */
static struct basis basis_of(int L)
{
    struct basis p = { 0 };

    add(&p, POLE_PAIR, -1.7 / L, 0.613);
    add(&p, POLE_PAIR, -2.1 / L, 0.613 + 0.9 / L);
    add(&p, POLE_PAIR, -0.083, 1.937);
    add(&p, POLE_PAIR, 20.7 / L, 2.611);
    add(&p, POLE_REAL, 0, 0);
    add(&p, POLE_NEGATIVE, -3.3 / L, 0);
    add(&p, POLE_REAL, -36, 0);
    return p;
}

/* Column j of M in row l, of the definition: the largest entry of a column of Phi is 1, D is
 * centred where its column has its weight. */
static long double entry(const struct basis *p, int L, int j, int l)
{
    int i = 0, c = j % p->order;
    long double a, centre, x;

    while (i + 1 < p->count && p->column[i + 1] <= c)
        i++;
    a = p->a[i];
    centre = a == 0  ? 0.5L * (L - 1)
             : a > 0 ? L - 1 - fminl(0.5L * L, 1 / a)
                     : fminl(0.5L * L, -1 / a);
    x = expl(a * l - (a > 0 ? a * (L - 1) : 0));
    if (p->kind[i] == POLE_PAIR)
        x *= c == p->column[i] ? cosl((long double)p->b[i] * l) : -sinl((long double)p->b[i] * l);
    if (p->kind[i] == POLE_NEGATIVE && l % 2)
        x = -x;
    return j < p->order ? x : x * (l - centre);
}

/* The record by blocks, of poles not quite where they are. */
static struct compressed *blocks_about(const struct basis *p, const struct matrix *Y)
{
    struct compressed *c = compressed_new(Y);
    double a[POLES], b[POLES];
    const struct doubling_poles poles = { p->count, p->order, p->kind, p->column, p->a, p->b },
        known = { p->count, p->order, p->kind, p->column, a, b };

    for (int j = 0; j < p->count; j++)
        a[j] = p->a[j] + 1e-7, b[j] = p->b[j] - 1e-7;
    CHECK(c != NULL && !compressed_holds(c, &poles));
    CHECK(compressed_about(c, &known, NULL) == MODAL_OK && compressed_holds(c, &poles));
    return c;
}

static void agree(int L, bool derivatives, int S, int most, bool by_blocks)
{
    const double near = (by_blocks ? 500 : 100) * DBL_EPSILON;   /* Q rounds as well */
    struct basis p = basis_of(L);
    const struct doubling_poles poles = { p.count, p.order, p.kind, p.column, p.a, p.b };
    int n = derivatives ? 2 * p.order : p.order;
    struct doubling *d;
    struct compressed *blocks = NULL;
    double R[COLUMNS_MOST * COLUMNS_MOST], Z[COLUMNS_MOST * 8], rest2[8],
        *y = malloc(sizeof *y * (size_t)(L + 3) * (size_t)S);
    struct matrix Y = { L, S, L + 3, y };
    long double *M = malloc(sizeof *M * (size_t)L * (size_t)n), norm[COLUMNS_MOST] = { 0 };
    struct random r = { 77 };

    for (size_t i = 0; i < (size_t)(L + 3) * (size_t)S; i++)
        y[i] = random_normal(&r);
    if (by_blocks)
        blocks = blocks_about(&p, &Y);
    d = doubling_new(L, n, most, blocks);
    CHECK(d != NULL && doubling_pays(L, n, S));
    for (int j = 0; j < n; j++) {
        for (int l = 0; l < L; l++) {
            M[l + (size_t)j * (size_t)L] = entry(&p, L, j, l);
            norm[j] += M[l + (size_t)j * (size_t)L] * M[l + (size_t)j * (size_t)L];
        }
        norm[j] = sqrtl(norm[j]);
    }
    CHECK(doubling_factor(d, &poles, R, NULL) == MODAL_OK);
    CHECK(doubling_project(d, &Y, 0, S, Z, rest2, NULL) == MODAL_OK);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            long double sum = 0, own = 0;
            for (int l = 0; l < L; l++)
                sum += M[l + (size_t)i * (size_t)L] * M[l + (size_t)j * (size_t)L];
            for (int k = 0; k < n; k++)
                own += (long double)R[k + i * n] * R[k + j * n];
            CHECK_NEAR((double)((own - sum) / (norm[i] * norm[j])), 0, near);
            CHECK(i <= j || R[i + j * n] == 0);
        }
    for (int c = 0; c < S; c++) {
        long double all = 0, part = rest2[c];
        for (int l = 0; l < L; l++)
            all += (long double)y[l + (size_t)c * (size_t)(L + 3)] *
                   y[l + (size_t)c * (size_t)(L + 3)];
        for (int k = 0; k < n; k++)
            part += (long double)Z[k + c * n] * Z[k + c * n];
        CHECK_NEAR((double)(part / all), 1, near);
        for (int j = 0; j < n; j++) {
            long double sum = 0, own = 0;
            for (int l = 0; l < L; l++)
                sum += M[l + (size_t)j * (size_t)L] * y[l + (size_t)c * (size_t)(L + 3)];
            for (int k = 0; k < n; k++)
                own += (long double)R[k + j * n] * Z[k + c * n];
            CHECK_NEAR((double)((own - sum) / (norm[j] * sqrtl(all))), 0, near);
        }
    }
    doubling_free(d);
    compressed_free(blocks);
    free(M), free(y);
}

TEST(the_triangle_and_the_projections_are_those_of_the_whole_basis)
{
    agree(4096, true, 3, 3, false);
    agree(4096, false, 3, 3, false);
}

/* Neighbours 1e-7 apart over some hundred rows: (1e-5)^3 / 6 is rounding. */
TEST(a_record_by_its_blocks_gives_the_same_triangle_and_projections)
{
    agree(9000, true, 3, 3, true);
    agree(7931, false, 5, 2, true);
}

TEST(rows_left_over_and_columns_in_panels_change_nothing)
{
    agree(1931, true, 5, 2, false);
    agree(2047, true, 1, 1, false);
    agree(1999, false, 8, 3, false);
}

/* What the poles make is left with rounding only, (4 + theta L / 4) DBL_EPSILON of it: nothing
 * cancels. */
TEST(of_the_basis_own_columns_nothing_but_rounding_is_left)
{
    enum { L = 3001 };
    struct basis p = basis_of(L);
    const struct doubling_poles poles = { p.count, p.order, p.kind, p.column, p.a, p.b };
    struct doubling *d = doubling_new(L, 2 * p.order, 1, NULL);
    static double y[L];
    const struct matrix Y = { L, 1, L, y };
    double R[COLUMNS_MOST * COLUMNS_MOST], Z[COLUMNS_MOST], rest2, all = 0;

    for (int l = 0; l < L; l++) {
        y[l] = (double)(entry(&p, L, 0, l) - 2.31L * entry(&p, L, 3, l) +
                        0.77L * entry(&p, L, 6, l) + 1.9L * entry(&p, L, 8, l));
        all += y[l] * y[l];
    }
    CHECK(doubling_factor(d, &poles, R, NULL) == MODAL_OK);
    CHECK(doubling_project(d, &Y, 0, 1, Z, &rest2, NULL) == MODAL_OK);
    CHECK(sqrt(rest2 / all) < (4 + 2.611 * L / 4) * DBL_EPSILON);
    doubling_free(d);
}

TEST(short_records_and_many_unknowns_do_not_pay)
{
    CHECK(!doubling_pays(100, 12, 3) && !doubling_pays(0, 4, 1) && !doubling_pays(400, 200, 3) &&
          !doubling_pays(5000, 0, 3));
    CHECK(doubling_pays(70000, 80, 3));
}

/* Rows left over are more than half of the blocks: the later half must not take them for blocks. */
TEST(halves_of_a_record_by_its_blocks_are_those_rows)
{
    enum { L = 7935, S = 2 };
    struct basis p = basis_of(L);
    const struct doubling_poles poles = { p.count, p.order, p.kind, p.column, p.a, p.b };
    double *y = malloc(sizeof *y * L * S), R[2][COLUMNS_MOST * COLUMNS_MOST],
        Z[2][COLUMNS_MOST * S], rest2[2][S];
    struct matrix Y = { L, S, L, y };
    struct random r = { 78 };
    struct compressed *c;

    for (int i = 0; i < L * S; i++)
        y[i] = random_normal(&r);
    c = blocks_about(&p, &Y);
    CHECK(c->left > 1 << (c->levels - 1));
    for (int later = 0; later < 2; later++) {
        struct compressed *h = compressed_half(c, later);
        CHECK(h != NULL && compressed_holds(h, &poles));
        CHECK(h->Y.x == (later ? y + (L - h->Y.m) : y));
        for (int by = 0; by < 2; by++) {
            struct doubling *d = doubling_new(h->Y.m, p.order, S, by ? h : NULL);
            CHECK(doubling_factor(d, &poles, R[by], NULL) == MODAL_OK);
            CHECK(doubling_project(d, &h->Y, 0, S, Z[by], rest2[by], NULL) == MODAL_OK);
            doubling_free(d);
        }
        for (int k = 0; k < S; k++)
            CHECK_NEAR(rest2[1][k] / rest2[0][k], 1, 1e-12);
        compressed_free(h);
    }
    compressed_free(c);
    free(y);
}
