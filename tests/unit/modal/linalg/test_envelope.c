/* test_envelope.c - the factor of a matrix of blocks against its definition */
#include "check.h"
#include "modal/linalg/envelope.h"

enum { BLOCKS = 4, N = 9 };
static const int first[BLOCKS] = { 0, 1, 0, 1 }, rows[BLOCKS] = { 2, 3, 1, 3 };

/* A of entries with no pattern within the envelope, its diagonal larger than their sums. */
static void fill(struct envelope *e, double *A)
{
    for (int k = 0; k < BLOCKS; k++)
        for (int j = first[k]; j <= k; j++)
            for (int c = 0; c < rows[j]; c++)
                for (int r = 0; r < rows[k]; r++) {
                    int at = e->block[k].start + r, to = e->block[j].start + c;
                    double x = at == to ? 7.3 + at : sin(2.7 * at * to + at + to);
                    *envelope_entry(e, k, r, j, c) = x;
                    A[at + N * to] = A[to + N * at] = x;
                }
}

/* F F^T x = b leaves D A D x + damping x = b, D A D of a unit diagonal. */
TEST(forward_and_back_solve_what_was_factored)
{
    struct workspace memory = { 0 };
    struct envelope_block block[BLOCKS];
    struct envelope e = { .block = block, .count = BLOCKS };
    double A[N * N] = { 0 }, scale[N], x[N], b[N], damping = 0.03;

    for (int k = 0; k < BLOCKS; k++)
        block[k] = (struct envelope_block) { .first = first[k], .rows = rows[k] };
    envelope_room(&e, &memory);
    CHECK(workspace_check(&memory, "", NULL) == MODAL_OK);
    fill(&e, A);
    for (int i = 0; i < N; i++)
        scale[i] = 1 / sqrt(A[i * (N + 1)]), x[i] = b[i] = cos(3.1 * i);
    CHECK(envelope_factor(&e, scale, damping));
    envelope_forward(&e, 0, x);
    envelope_back(&e, x);
    for (int i = 0; i < N; i++) {
        double sum = damping * x[i];
        for (int j = 0; j < N; j++)
            sum += scale[i] * A[i + N * j] * scale[j] * x[j];
        CHECK_NEAR(sum, b[i], 1e-13);
    }
    workspace_free(&memory);
}

/* From the block where b begins on, the answer is that from the first. */
TEST(a_solution_may_begin_where_its_right_hand_side_does)
{
    struct workspace memory = { 0 };
    struct envelope_block block[BLOCKS];
    struct envelope e = { .block = block, .count = BLOCKS };
    double A[N * N], scale[N], x[N] = { 0 }, y[N] = { 0 };

    for (int k = 0; k < BLOCKS; k++)
        block[k] = (struct envelope_block) { .first = first[k], .rows = rows[k] };
    envelope_room(&e, &memory);
    fill(&e, A);
    for (int i = 0; i < N; i++)
        scale[i] = 1 / sqrt(7.3 + i);
    x[3] = y[3] = 1.7;                                 /* of block 1 */
    CHECK(envelope_factor(&e, scale, 0));
    envelope_forward(&e, 0, x);
    envelope_forward(&e, 1, y);
    for (int i = 0; i < N; i++)
        CHECK_NEAR(x[i], y[i], 1e-15);
    workspace_free(&memory);
}

/* Of an entry larger than both of its diagonal's no factor is to be had. */
TEST(what_is_not_positive_has_no_factor)
{
    struct workspace memory = { 0 };
    struct envelope_block block[2] = { { .rows = 1 }, { .rows = 1 } };
    struct envelope e = { .block = block, .count = 2 };
    double scale[2] = { 1, 1 };

    envelope_room(&e, &memory);
    *envelope_entry(&e, 0, 0, 0, 0) = *envelope_entry(&e, 1, 0, 1, 0) = 1;
    *envelope_entry(&e, 1, 0, 0, 0) = 1.3;
    CHECK(!envelope_factor(&e, scale, 0.1));
    CHECK(envelope_factor(&e, scale, 0.5));
    workspace_free(&memory);
}
