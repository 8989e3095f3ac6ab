/*
 * matrices.c - a structure given by its matrices: M x'' + (C + speed G) x' + K x
 *
 * M must be symmetric (to 1e-9 of its largest entry) and positive definite (scene.c checks), G skew
 * (to the same); C and K are free: follower forces make K unsymmetric.  Nested lists, or a sparse
 * form of scene.h.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/lowering.h"
#include "modal/scene/scene.h"
#include "modal/scene/scene_arrays.h"

/* of the largest entry: matrices written with nine digits or more are what they are meant to be */
static const double SYMMETRY = 1e-9;

struct matrices { const cJSON *M, *C, *K, *G, *dofs, *file; double speed; };

static const struct scene_key keys[] = {
    { "M", SCENE_OWN, offsetof(struct matrices, M), "kg", .needed = true, .unless = "file",
      .means = "mass: symmetric, positive definite; a list of rows, sparse, or, as the others, a "
      "Matrix Market file, which clients put in its place",
      .example = "[[2, 0], [0, 3]]" },
    { "C", SCENE_OWN, offsetof(struct matrices, C), "N s/m", .otherwise = "none",
      .means = "damping, of any form", .example = "[[0.1, 0], [0, 0.1]]" },
    { "K", SCENE_OWN, offsetof(struct matrices, K), "N/m", .needed = true, .unless = "file",
      .means = "stiffness, of any form: follower forces make it unsymmetric",
      .example = "[[30, -10], [-10, 30]]" },
    { "G", SCENE_OWN, offsetof(struct matrices, G), "kg", .otherwise = "none",
      .means = "gyroscopic, skew; speed G adds to C", .example = "[[0, 1], [-1, 0]]" },
    { "speed", SCENE_NUMBER, offsetof(struct matrices, speed), "rad/s", -HUGE_VAL, HUGE_VAL,
      .with = "G", .means = "of G, which needs it", .example = "2" },
    { "dofs", SCENE_OWN, offsetof(struct matrices, dofs), .otherwise = "x1, x2, ..",
      .means = "names, one a row", .example = "[\"a\", \"b\"]" },
    { "file", SCENE_OWN, offsetof(struct matrices, file), .otherwise = "none",
      .means = "HDF5 with M, C, K, G, which clients put in its place", .example = "\"X.h5\"" },
    { 0 },
};

struct entries { struct triplet *x; int count, m, n; };

/* What a matrix may look like, wherever it does not. */
static enum modal_status shape_error(const char *where, const char *what, struct modal_error *err)
{
    return modal_fail_field(err, MODAL_BAD_INPUT, where,
                            "%s: %s; accepted: a list of rows of equal length, or "
                            "{\"shape\", \"row_pointers\", \"columns\", \"values\"}",
                            where, what);
}

/* Zeros are no entries. */
static enum modal_status read_row(const cJSON *row, int i, const char *where, struct entries *out,
                                  struct modal_error *err)
{
    char at[160];
    const cJSON *item;
    int j = 0;

    if (!cJSON_IsArray(row) || cJSON_GetArraySize(row) != out->n)
        return shape_error(where, "its rows differ in length", err);
    cJSON_ArrayForEach(item, row) {
        if (!cJSON_IsNumber(item)) {
            snprintf(at, sizeof at, "%.90s[%d][%d]", where, i, j);
            return modal_fail_field(err, MODAL_BAD_INPUT, at, "%s is not a number", at);
        }
        if (item->valuedouble != 0)
            out->x[out->count++] = (struct triplet) { i, j, item->valuedouble };  /* by rows */
        j++;
    }
    return MODAL_OK;
}

/* The first row says how many columns there are. */
static enum modal_status read_dense(const cJSON *list, const char *where, struct entries *out,
                                    struct modal_error *err)
{
    const cJSON *row;
    enum modal_status rc = MODAL_OK;
    int i = 0;

    out->m = cJSON_GetArraySize(list);  /* rows */
    /* columns of the first; the others must have as many */
    out->n = cJSON_GetArraySize(list->child);
    if (out->m < 1 || !cJSON_IsArray(list->child))  /* before room is made */
        return shape_error(where, "not a matrix", err);
    /* before m n triplets are asked for */
    if ((double)out->m * out->n > LOWERING_ENTRIES_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, where, "%s is %d x %d; accepted: at most %d "
                                "entries, with their zeros", where, out->m, out->n,
                                LOWERING_ENTRIES_MOST);
    out->x = malloc(((size_t)out->m * (size_t)out->n + 1) * sizeof *out->x);
    if (out->x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "scene: out of memory");
    cJSON_ArrayForEach(row, list) {
        if (rc == MODAL_OK)
            rc = read_row(row, i++, where, out, err);
    }
    return rc;
}

/* Row pointers ascending from 0 to the number of values, columns in range. */
static enum modal_status check_rows(const double *start, size_t starts, const double *column,
                                    size_t columns, size_t values, const double *shape,
                                    const char *where, struct modal_error *err)
{
    if (starts != (size_t)shape[0] + 1 || columns != values || start[0] != 0
        || start[starts - 1] != (double)values)
        return shape_error(where, "row_pointers, columns and values do not fit the shape", err);
    for (size_t i = 1; i < starts; i++)  /* ascending, and whole */
        if (start[i] < start[i - 1] || start[i] != floor(start[i]))
            return shape_error(where, "row_pointers must not descend", err);
    for (size_t k = 0; k < columns; k++)
        /* a fraction, or past the shape */
        if (column[k] != floor(column[k]) || column[k] >= shape[1])
            return shape_error(where, "a column is outside the shape", err);
    return MODAL_OK;
}

/* Compressed rows: parts[] names their four lists. */
static enum modal_status read_sparse(const cJSON *json, const char *where, struct entries *out,
                                     struct modal_error *err)
{
    static const char *const parts[] = { "shape", "row_pointers", "columns", "values", NULL };
    double *x[4] = { NULL };  /* in the order of parts[] */
    size_t count[4] = { 0 };
    enum modal_status rc = json_keys(json, where, parts, err);

    for (int i = 0; i < 4 && rc == MODAL_OK; i++)
        rc = json_get_numbers(json, where, parts[i], i < 3 ? 0 : -HUGE_VAL,
                              i < 3 ? LOWERING_ENTRIES_MOST : HUGE_VAL, &x[i], &count[i], err);
    if (rc == MODAL_OK && (count[0] != 2 || count[1] < 1))
        rc = shape_error(where, "a key is missing or empty", err);
    if (rc == MODAL_OK
        && (x[0][0] < 1 || x[0][0] > LOWERING_DOFS_MOST || x[0][1] < 1
            || x[0][1] > LOWERING_DOFS_MOST))
        rc = modal_fail_field(err, MODAL_TOO_LARGE, where, "%s: shapes are 1 to %d", where,
                              LOWERING_DOFS_MOST);
    if (rc == MODAL_OK)
        rc = check_rows(x[1], count[1], x[2], count[2], count[3], x[0], where, err);
    if (rc == MODAL_OK && (out->x = malloc((count[3] + 1) * sizeof *out->x)) == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "scene: out of memory");
    if (rc == MODAL_OK) {
        out->m = (int)x[0][0];  /* in range: checked above */
        out->n = (int)x[0][1];
        for (int i = 0; i < out->m; i++)
            for (int k = (int)x[1][i]; k < (int)x[1][i + 1]; k++)
                out->x[out->count++] = (struct triplet) { i, (int)x[2][k], x[3][k] };
    }
    for (int i = 0; i < 4; i++)
        free(x[i]);
    return rc;
}

/* ITEM, which stands at WHERE, n x n where N > 0; NULL: out->m stays 0.  The caller frees
 * out->x. */
static enum modal_status read_matrix(const struct lowering *l, const cJSON *item, const char *where,
                                     int n, struct entries *out, struct modal_error *err)
{
    const struct scene_arrays *arrays = l->options != NULL ? l->options->arrays : NULL;
    enum modal_status rc;

    if (item == NULL)
        return MODAL_OK;
    if (!cJSON_IsArray(item) && !cJSON_IsObject(item))
        return shape_error(where, "not a matrix", err);
    rc = cJSON_IsArray(item)      ? read_dense(item, where, out, err)
         : scene_arrays_named(item) ? scene_arrays_read(arrays, item, where, &out->x, &out->count,
                                                        &out->m, &out->n, err)
                                    : read_sparse(item, where, out, err);
    if (rc == MODAL_OK && (out->m != out->n || (n > 0 && out->m != n)))
        rc = modal_fail_field(err, MODAL_BAD_INPUT, where, "%s is %d x %d; it must be %s", where,
                              out->m, out->n, n > 0 ? "square and as large as M" : "square");
    return rc;
}

/* a(i,j) = sign * a(j,i) for every entry, to 1e-9 of the largest. */
static enum modal_status check_symmetry(const struct entries *e, double sign, const char *where,
                                        struct modal_error *err)
{
    struct sparse a = { 0 }, t = { 0 };  /* A and sign A^T, rows ascending */
    struct triplet *turned = malloc(((size_t)e->count + 1) * sizeof *turned);
    double largest = 0;
    enum modal_status rc =
        turned != NULL ? MODAL_OK : modal_fail(err, MODAL_NO_MEMORY, "scene: out of memory");

    for (int k = 0; rc == MODAL_OK && k < e->count; k++) {
        turned[k] = (struct triplet) { e->x[k].i, e->x[k].j, e->x[k].value };
        /* before entries of one place add up: no smaller */
        largest = fmax(largest, fabs(e->x[k].value));
    }
    if (rc == MODAL_OK)
        rc = sparse_from_triplets(e->m, e->n, turned, e->count, &a, err);
    for (int k = 0; rc == MODAL_OK && k < e->count; k++)
        turned[k] = (struct triplet) { e->x[k].j, e->x[k].i, sign * e->x[k].value };  /* sign A^T */
    if (rc == MODAL_OK)
        rc = sparse_from_triplets(e->m, e->n, turned, e->count, &t, err);
    for (int i = 0; rc == MODAL_OK && i < a.m; i++) {
        int p = a.start[i], q = t.start[i];  /* both rows ascend: one walk compares them */
        while (rc == MODAL_OK && (p < a.start[i + 1] || q < t.start[i + 1])) {
            int ja = p < a.start[i + 1] ? a.index[p] : a.n,  /* past the end: n, larger than any */
                jt = q < t.start[i + 1] ? t.index[q] : a.n, j = ja < jt ? ja : jt;
            double difference = (ja == j ? a.value[p++] : 0) - (jt == j ? t.value[q++] : 0);
            if (fabs(difference) > SYMMETRY * largest)
                rc = modal_fail_field(err, MODAL_BAD_INPUT, where,
                                      "%s must be %s; entries (%d, %d) and (%d, %d) differ by %g",
                                      where, sign > 0 ? "symmetric" : "skew", i, j, j, i,
                                      difference);
        }
    }
    free(turned);
    sparse_done(&a);
    sparse_done(&t);
    return rc;
}

/* FACTOR times ITEM, which stands at WHERE, into MATRIX; SIGN: it must be its transpose times
 * that (0: any). */
static enum modal_status add_matrix(struct lowering *l, const cJSON *item, const char *where,
                                    int matrix, double factor, double sign, struct modal_error *err)
{
    struct entries e = { 0 };
    enum modal_status rc = read_matrix(l, item, where, l->p->n, &e, err);

    if (rc == MODAL_OK && sign != 0)
        rc = check_symmetry(&e, sign, where, err);
    for (int k = 0; rc == MODAL_OK && k < e.count; k++)
        lowering_add(l, matrix, e.x[k].i, e.x[k].j, factor * e.x[k].value);
    free(e.x);
    return rc;
}

static enum modal_status bad_name(int i, struct modal_error *err)
{
    char at[32];

    snprintf(at, sizeof at, "structure.dofs[%d]", i);
    return modal_fail_field(
        err, MODAL_BAD_INPUT, at,
        "%s must be a name of 1 to 63 bytes that stands once and is not \"ground\"", at);
}

/* The first that has stood before, by the names in their order: each compared with all others would
 * take hours of a million. */
static enum modal_status check_names(struct program *p, struct modal_error *err)
{
    enum modal_status rc = program_order_names(p, err);
    int twice = p->n;

    for (int i = 1; rc == MODAL_OK && i < p->n; i++)
        if (strcmp(p->dofs[p->by_name[i - 1]], p->dofs[p->by_name[i]]) == 0
            && p->by_name[i] < twice)
            twice = p->by_name[i];
    free(p->by_name);
    p->by_name = NULL;
    return rc == MODAL_OK && twice < p->n ? bad_name(twice, err) : rc;
}

/* The names in `dofs`, default x1, x2, ...: n of them, none twice. */
static enum modal_status add_dofs(struct lowering *l, const cJSON *list, int n,
                                  struct modal_error *err)
{
    const cJSON *item = NULL;
    char name[64];

    if (list != NULL && (!cJSON_IsArray(list) || cJSON_GetArraySize(list) != n))
        return modal_fail_field(err, MODAL_BAD_INPUT, "structure.dofs",
                                "structure.dofs must list %d names", n);
    if (list != NULL)  /* the first name, if names are given */
        item = list->child;
    for (int i = 0; i < n; i++, item = item != NULL ? item->next : NULL) {
        if (list != NULL
            && (!cJSON_IsString(item) || item->valuestring[0] == '\0'
                || strlen(item->valuestring) >= sizeof name
                || strcmp(item->valuestring, "ground") == 0))
            return bad_name(i, err);
        snprintf(name, sizeof name, "x%d", i + 1);  /* the default */
        if (lowering_add_dof(l, list != NULL ? item->valuestring : name) < 0)
            return modal_fail(err, MODAL_NO_MEMORY, "scene: out of memory");
    }
    return list != NULL ? check_names(l->p, err) : MODAL_OK;
}

/* Dofs before entries, entries before effects. */
static enum modal_status lower(struct lowering *l, void *values, struct modal_error *err)
{
    const struct matrices *s = values;
    struct entries M = { 0 };
    enum modal_status rc;

    if (s->file != NULL)
        return modal_fail_field(err, MODAL_BAD_INPUT, "structure.file",
                                "files are opened by clients, which put the matrices in its place");
    rc = read_matrix(l, s->M, "structure.M", 0, &M, err);  /* any size: it says n */
    /* read for its size: entries come once there are dofs */
    free(M.x);
    if (rc == MODAL_OK)
        rc = add_dofs(l, s->dofs, M.m, err);
    if (rc == MODAL_OK)
        rc = add_matrix(l, s->M, "structure.M", PROGRAM_M, 1, 1, err);
    if (rc == MODAL_OK)
        rc = add_matrix(l, s->C, "structure.C", PROGRAM_C, 1, 0, err);
    if (rc == MODAL_OK && s->G != NULL)
        rc = add_matrix(l, s->G, "structure.G", PROGRAM_C, s->speed, -1, err);
    if (rc == MODAL_OK)
        rc = add_matrix(l, s->K, "structure.K", PROGRAM_K, 1, 0, err);
    return rc;
}

const struct scene_structure_kind structure_matrices = {
    .name = "matrices", .keys = { scene_type_keys, keys }, .size = sizeof(struct matrices),
    .law = "M x'' + (C + speed G) x' + K x = p", .lower = lower,
};
