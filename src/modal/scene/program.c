/* program.c - see program.h
 *
 * The hash runs over every number of the program in the order of its declaration, lengths first,
 * doubles by their eight bytes (little-endian hosts), names with their lengths: two programs with
 * one hash step and solve alike. Counters (evaluations, seconds, active) are left out: they are
 * what running a program writes.  Laws enter by their class's name, dofs and memory, and by the
 * text of their effect, which holds all their numbers.
 */
#include "modal/scene/program.h"
#include <stdlib.h>
#include <string.h>
#include "base/sha256.h"

/* Eight bytes, as they lie: hosts are little-endian (see the opening). */
static void add_int(struct sha256 *s, int64_t x)
{
    sha256_add(s, &x, sizeof x);
}

/* By their bits, but that -0 is 0: programs of one hash step alike to the last of them. */
static void add_doubles(struct sha256 *s, const double *x, int count)
{
    add_int(s, count);
    for (int i = 0; x != NULL && i < count; i++) {
        double value = x[i] == 0 ? 0 : x[i];             /* -0 and 0 are one number */
        sha256_add(s, &value, sizeof value);
    }
}

/* With its length, so that "a", "bc" is not "ab", "c". */
static void add_text(struct sha256 *s, const char *text)
{
    add_int(s, (int64_t)strlen(text));
    sha256_add(s, text, strlen(text));
}

/* Pattern and values. */
static void add_sparse(struct sha256 *s, const struct sparse *a)
{
    int entries = a->start != NULL ? a->start[a->m] : 0;  /* none of an empty matrix */

    add_int(s, a->m);  /* shape first: lists have no other end */
    add_int(s, a->n);
    for (int i = 0; a->start != NULL && i <= a->m; i++)
        add_int(s, a->start[i]);
    for (int k = 0; k < entries; k++)
        add_int(s, a->index[k]);
    add_doubles(s, a->value, entries);
}

/* All members, whatever the type reads. */
static void add_load(struct sha256 *s, const struct program_load *load)
{
    /* unread ones are 0 in every program */
    const double numbers[] = { load->cosine,   load->sine,  load->amplitude,
                               load->duration, load->start, load->turn };

    add_int(s, load->dof);
    add_int(s, load->type);
    add_int(s, load->k);
    for (int j = 0; load->tones > 0 && j < PROGRAM_TONES_MOST; j++)
        add_int(s, load->tone[j]);
    add_doubles(s, numbers, 6);
    add_doubles(s, load->time, load->points);
    add_doubles(s, load->force, load->points);
    add_int(s, load->dof_sine);
}

/* Where it acts; its numbers stand in the effect's text. */
static void add_law(struct sha256 *s, const struct law *law)
{
    add_text(s, law->kind->name);
    add_int(s, law->effect);  /* which row it counts in */
    for (int i = 0; i < law->kind->inputs; i++)
        add_int(s, law->start[i + 1]);
    for (int e = 0; e < law_ends(law); e++) {
        add_int(s, law->end[e].dof);
        add_doubles(s, &law->end[e].weight, 1);
    }
    add_int(s, law->memory);
}

/* The name too: it is in the batch that simulating makes. */
static void add_output(struct sha256 *s, const struct program_output *output)
{
    add_text(s, output->name);
    add_int(s, output->count);
    for (int i = 0; i < output->count; i++) {
        add_int(s, output->terms[i].i);
        add_int(s, output->terms[i].j);
        add_doubles(s, &output->terms[i].value, 1);
    }
}

/* (1) to (3) of program.h, in their order. */
static void add_matrices(struct sha256 *s, const struct program *p)
{
    /* in the order of program.h */
    const struct sparse *blocks[] = { &p->E, &p->A, &p->Bx, &p->Bv, &p->Ba, &p->F };

    for (int i = 0; i < 3; i++)
        add_sparse(s, &p->constant[i]);
    add_int(s, p->harmonics);  /* how many follow */
    for (int h = 0; h < p->harmonics; h++) {
        add_int(s, p->harmonic[h].k);
        for (int i = 0; i < 3; i++) {
            add_sparse(s, &p->harmonic[h].cosine[i]);
            add_sparse(s, &p->harmonic[h].sine[i]);
        }
    }
    add_int(s, p->n_linear);
    for (int i = 0; i < 6; i++)
        add_sparse(s, blocks[i]);
}

void program_hash(struct program *p)
{
    struct sha256 s;
    uint8_t digest[32];
    const double numbers[] = { p->omega, p->period,
                               p->seen_fixed ? -p->frame_speed : p->frame_speed };

    sha256_init(&s);
    add_int(&s, p->n);  /* n, then names: their number is known */
    for (int i = 0; i < p->n; i++)
        add_text(&s, p->dofs[i]);
    add_matrices(&s, p);
    add_int(&s, p->laws);
    for (int i = 0; i < p->laws; i++)
        add_law(&s, &p->law[i]);
    if (p->tones[0] > 0)  /* programs without keep the hash that they had */
        add_doubles(&s, p->tones, PROGRAM_TONES_MOST);
    add_int(&s, p->loads);
    for (int i = 0; i < p->loads; i++)
        add_load(&s, &p->load[i]);
    add_int(&s, p->outputs);
    for (int i = 0; i < p->outputs; i++)
        add_output(&s, &p->output[i]);
    add_int(&s, p->effects);
    for (int i = 0; i < p->effects; i++) {
        add_text(&s, p->effect[i].type);
        add_int(&s, p->effect[i].states);
        /* laws' numbers, as the scene has them */
        add_text(&s, p->effect[i].law_text != NULL ? p->effect[i].law_text : "");
    }
    add_doubles(&s, p->x0, p->n);
    add_doubles(&s, p->v0, p->n);
    add_doubles(&s, numbers, 3);
    sha256_end(&s, digest);  /* of all of it */
    sha256_hex(digest, p->hash);
}

double program_load_frequency(const struct program *p, const struct program_load *load)
{
    double sum = load->tones > 0 ? 0 : load->k * p->omega;

    for (int j = 0; j < load->tones; j++)
        sum += load->tone[j] * p->tones[j];
    return sum;
}

enum program_class program_class(const struct program *p)
{
    return p->laws > 0                         ? PROGRAM_NONLINEAR
           : p->harmonics > 0 || p->seen_fixed ? PROGRAM_LINEAR_PERIODIC
                                               : PROGRAM_LINEAR_CONSTANT;
}

const char *program_class_name(enum program_class class)
{
    static const char *const names[] = { "linear-constant", "linear-periodic", "nonlinear" };

    return names[class];
}

bool program_of_dofs(const struct program *p)
{
    if (p->n == 0 || p->n_linear > 0 || p->seen_fixed || p->frame_speed != 0)
        return false;
    for (int h = 0; h < p->harmonics; h++)
        if (p->harmonic[h].cosine[PROGRAM_M].m > 0 || p->harmonic[h].sine[PROGRAM_M].m > 0)
            return false;
    return true;
}

int program_states(const struct program *p)
{
    int states = 2 * p->n + p->n_linear;

    for (int i = 0; i < p->laws; i++)
        states += p->law[i].memory;
    return states;
}

/* qsort_r: by name, of one name by number. */
static int by_name(const void *a, const void *b, void *names)
{
    int x = *(const int *)a, y = *(const int *)b, order = strcmp(((char **)names)[x],
                                                                 ((char **)names)[y]);

    return order != 0 ? order : (x > y) - (x < y);
}

enum modal_status program_order_names(struct program *p, struct modal_error *err)
{
    p->by_name = malloc(((size_t)p->n + 1) * sizeof *p->by_name);
    if (p->by_name == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "scene: out of memory");
    for (int i = 0; i < p->n; i++)
        p->by_name[i] = i;
    qsort_r(p->by_name, (size_t)p->n, sizeof *p->by_name, by_name, p->dofs);
    return MODAL_OK;
}

int program_dof(const struct program *p, const char *name)
{
    int low = 0, high = p->n;

    for (int i = 0; p->by_name == NULL && i < p->n; i++)
        if (strcmp(p->dofs[i], name) == 0)
            return i;
    while (p->by_name != NULL && low < high) {
        int middle = (low + high) / 2;

        if (strcmp(p->dofs[p->by_name[middle]], name) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    return p->by_name != NULL && low < p->n && strcmp(p->dofs[p->by_name[low]], name) == 0
               ? p->by_name[low] : -1;
}

/* Constant, harmonic and of linear states. */
static void free_matrices(struct program *p)
{
    for (int i = 0; i < 3; i++)
        sparse_done(&p->constant[i]);
    for (int h = 0; h < p->harmonics; h++)
        for (int i = 0; i < 3; i++) {
            sparse_done(&p->harmonic[h].cosine[i]);
            sparse_done(&p->harmonic[h].sine[i]);
        }
    free(p->harmonic);
    sparse_done(&p->E);
    sparse_done(&p->A);
    sparse_done(&p->Bx);
    sparse_done(&p->Bv);
    sparse_done(&p->Ba);
    sparse_done(&p->F);
}

void program_free(struct program *p)
{
    if (p == NULL)  /* accepted */
        return;
    free_matrices(p);
    for (int i = 0; i < p->n; i++)
        free(p->dofs[i]);
    free(p->dofs);
    free(p->by_name);
    for (int i = 0; i < p->laws; i++)
        law_done(&p->law[i]);
    free(p->law);
    for (int i = 0; i < p->loads; i++) {
        free(p->load[i].time);
        free(p->load[i].force);
    }
    free(p->load);
    for (int i = 0; i < p->outputs; i++) {
        free(p->output[i].name);
        free(p->output[i].terms);
    }
    free(p->output);
    for (int i = 0; i < p->effects; i++) {
        free(p->effect[i].type);
        free(p->effect[i].law_text);
    }
    free(p->effect);
    free(p->x0);
    free(p->v0);
    free(p->turn_partner);
    free(p->turn_sign);
    free(p);
}
