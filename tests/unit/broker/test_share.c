/*
 * test_share.c - whose job starts next: seconds in proportion to weights, whatever arrives and
 * whatever jobs take
 *
 * Users with backlog are given equal rounds, so that their seconds over their weights, S/w, differ
 * by what one owes, and by what the other has left and was charged for what runs: with W workers
 * and jobs (and means of jobs) of at most L seconds at most W L, q w and W L.
 * So, w the least weight, |S_i/w_i - S_j/w_j| <= 2 W L / w + q over any time in which both have
 * backlog and before which neither  (1) had any, and twice that otherwise, for each may begin with
 * a debt or a credit.
 */
/* Tests as well: users.c */
#include "check.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "broker/core/jobs.h"
#include "broker/core/state.h"

enum { WORKERS = 2, USERS = 3 };

static const double quantum_s = 0.05;

struct running { struct user *user; double end, took, expected; };

struct lab {
    struct core *core;
    struct settings settings;
    struct account accounts[USERS];
    struct user *users[USERS];
    struct running at[WORKERS];
    double now, served[USERS];
    uint64_t dice;
};

static double chance(struct lab *lab)
{
    lab->dice = lab->dice * 6364136223846793005u + 1442695040888963407u;
    return (double)(lab->dice >> 11) * 0x1p-53;
}

static void lab_open(struct lab *lab, const double weights[USERS], uint64_t seed)
{
    static const char *const names[USERS] = { "ann", "ben", "eve" };

    memset(lab, 0, sizeof *lab);
    lab->dice = seed;
    for (int u = 0; u < USERS; u++) {
        lab->accounts[u] = (struct account) { .role = WIRE_ROLE_SUBMIT, .weight = weights[u] };
        strcpy(lab->accounts[u].user, names[u]);
        strcpy(lab->accounts[u].key, names[u]);
    }
    lab->settings = (struct settings) { .accounts = lab->accounts, .account_count = USERS };
    lab->core = core_new(&lab->settings, (struct moment) { 0, 1000 * SECOND });
    for (int u = 0; u < USERS; u++)
        lab->users[u] = user_get(lab->core, names[u]);
}

static void submit(struct lab *lab, int u)
{
    struct core *c = lab->core;
    struct job *job = job_new(c, lab->users[u], c->jobs->next_job++);

    job->kind = "identify";
    job->submitted_ns = c->now.utc_ns;
    job->committed = true;
    c->jobs->state_counts[JOB_QUEUED]++;
    lab->users[u]->queued++;
    job_index(c, job);
    job_enqueue(c, job);
}

static int number_of(const struct lab *lab, const struct user *user)
{
    int u = 0;

    while (lab->users[u] != user)
        u++;
    return u;
}

/* Free workers take what is next; a job of user u takes SECONDS(lab, u). */
static void start(struct lab *lab, double (*seconds)(struct lab *, int))
{
    for (int k = 0; k < WORKERS; k++) {
        struct job *job = lab->at[k].user != NULL ? NULL : user_next(lab->core, 0);
        struct user *user;
        if (job == NULL)
            continue;
        user = job->user;
        job_forget(lab->core, job);
        user->running++;
        lab->at[k] = (struct running) { .user = user,
                                       .expected = user->cost_s,
                                       .took = seconds(lab, number_of(lab, user)) };
        lab->at[k].end = lab->now + lab->at[k].took;
    }
}

/* To the next end of a job, or to UNTIL. */
static void advance(struct lab *lab, double until)
{
    int first = -1;

    for (int k = 0; k < WORKERS; k++)
        if (lab->at[k].user != NULL && lab->at[k].end <= until &&
            (first < 0 || lab->at[k].end < lab->at[first].end))
            first = k;
    lab->now = first < 0 ? until : lab->at[first].end;
    lab->core->now.utc_ns = 1000 * SECOND + (int64_t)(1e9 * lab->now);
    if (first < 0)
        return;
    lab->served[number_of(lab, lab->at[first].user)] += lab->at[first].took;
    lab->at[first].user->running--;
    user_ran(lab->core, lab->at[first].user, lab->at[first].expected, lab->at[first].took,
             lab->at[first].took);
    lab->at[first].user = NULL;
}

/* Until UNTIL, each user in BACKLOG (bits) always having a job ready. */
static void run(struct lab *lab, double until, unsigned backlog,
                double (*seconds)(struct lab *, int))
{
    while (lab->now < until) {
        for (int u = 0; u < USERS; u++)
            while ((backlog >> u & 1) && lab->users[u]->ready.count < 2 * WORKERS)
                submit(lab, u);
        start(lab, seconds);
        advance(lab, until);
    }
}

static double bound(double longest, double least_weight)
{
    return 2 * WORKERS * longest / least_weight + quantum_s;
}

/* Ann's jobs are short, Ben's anything, Eve's short but one in twenty. */
static double mixed(struct lab *lab, int u)
{
    return u == 0 ? 0.02 : u == 1 ? 3 * chance(lab) : chance(lab) < 0.05 ? 3 : 0.1;
}

static double one_second(struct lab *lab, int u)
{
    (void)lab, (void)u;
    return 1;
}

static double an_hour(struct lab *lab, int u)
{
    (void)lab, (void)u;
    return 3600;
}

/* (1) with L = 3: seeds and weights at random, over half an hour. */
TEST(seconds_are_in_proportion_to_weights_whatever_jobs_take)
{
    double worst = 0;

    for (uint64_t seed = 1; seed <= 60; seed++) {
        struct lab lab;
        double weights[USERS], least = 1;
        lab_open(&lab, (const double[USERS]) { 1, 1, 1 }, seed);
        for (int u = 0; u < USERS; u++)
            lab.core->accounts[u].weight = weights[u] = 1 + floor(4 * chance(&lab));
        run(&lab, 1800, 7, mixed);
        for (int u = 0; u < USERS; u++)
            for (int v = 0; v < u; v++)
                worst = fmax(worst, fabs(lab.served[u] / weights[u] - lab.served[v] / weights[v]) /
                                        bound(3, least));
        core_free(lab.core);
    }
    printf("fair share: seconds over weights of three users differ by %.2f of the bound at most\n",
           worst);
    CHECK(worst <= 1);
}

/* Ann always waits; the others come and go: while one has backlog, (1) holds between her and him.
 */
TEST(who_comes_and_goes_has_his_share_from_the_moment_he_comes)
{
    double worst = 0;

    for (uint64_t seed = 1; seed <= 20; seed++) {
        struct lab lab;
        lab_open(&lab, (const double[USERS]) { 1, 2, 1 }, seed);
        run(&lab, 50, 1, mixed);
        for (int burst = 0; burst < 40; burst++) {
            unsigned who = 1 + (unsigned)(2 * chance(&lab)) ;
            double before[USERS], until = lab.now + 60 * chance(&lab);
            memcpy(before, lab.served, sizeof before);
            run(&lab, until, 1u | 1u << who, mixed);
            double ann = lab.served[0] - before[0],
                   his = (lab.served[who] - before[who]) / (who == 1 ? 2 : 1);
            worst = fmax(worst, fabs(ann - his) / (2 * bound(3, 1)));
            while (lab.users[who]->ready.count > 0)  /* what he left is done too, then he is away */
                run(&lab, lab.now + 1, 1, mixed);
            run(&lab, lab.now + 20 * chance(&lab), 1, mixed);
        }
        core_free(lab.core);
    }
    printf("fair share: of who comes and goes by %.2f of the bound at most\n", worst);
    CHECK(worst <= 1);
}

/* Ben's two hours were nobody else's loss: afterwards he has his half of 400 worker seconds at
 * once. */
TEST(what_a_user_took_while_nobody_waited_he_owes_nobody)
{
    struct lab lab;

    lab_open(&lab, (const double[USERS]) { 1, 1, 1 }, 7);
    submit(&lab, 1);
    submit(&lab, 1);
    while (lab.served[1] < 7200) {
        start(&lab, an_hour);
        advance(&lab, 1e9);
    }
    start(&lab, an_hour);                                     /* a worker asks, and nobody waits */
    double from = lab.served[1];
    run(&lab, lab.now + 200, 3, one_second);
    CHECK(fabs(lab.served[1] - from - lab.served[0]) <= bound(1, 1));
    core_free(lab.core);
}

/* Ann may use no more CPU today; Ben works on. When her day begins anew she has half, not all that
 * she missed. */
TEST(a_limit_that_holds_a_user_back_saves_him_no_credit)
{
    struct lab lab;

    lab_open(&lab, (const double[USERS]) { 1, 1, 1 }, 9);
    lab.core->accounts[0].most.cpu_s_day = 5;
    run(&lab, 3600, 3, one_second);
    CHECK(lab.served[0] <= 5 + WORKERS);
    double before[USERS];
    memcpy(before, lab.served, sizeof before);
    lab.core->accounts[0].most.cpu_s_day = 0;
    run(&lab, lab.now + 200, 3, one_second);
    CHECK(fabs((lab.served[0] - before[0]) - (lab.served[1] - before[1])) <= 2 * bound(1, 1));
    core_free(lab.core);
}

/* One step of priority is a minute of waiting: 100 against 90 goes first within ten minutes, and
 * later waits no longer. */
TEST(priority_is_worth_minutes_so_that_nothing_starves)
{
    struct lab lab;
    struct job *old;

    lab_open(&lab, (const double[USERS]) { 1, 1, 1 }, 11);
    old = job_new(lab.core, lab.users[0], lab.core->jobs->next_job++);
    *old = (struct job) { .id = old->id,
                         .user = old->user,
                         .kind = "identify",
                         .slot = -1,
                         .priority = 90,
                         .submitted_ns = lab.core->now.utc_ns,
                         .committed = true };
    lab.core->jobs->state_counts[JOB_QUEUED]++;
    lab.users[0]->queued++;
    job_index(lab.core, old);
    job_enqueue(lab.core, old);
    for (int minute = 0; minute < 12; minute++) {
        struct job *young = job_new(lab.core, lab.users[0], lab.core->jobs->next_job++);
        lab.core->now.utc_ns += 60 * SECOND;
        young->kind = "identify";
        young->priority = 100;
        young->submitted_ns = lab.core->now.utc_ns;
        young->committed = true;
        lab.core->jobs->state_counts[JOB_QUEUED]++;
        lab.users[0]->queued++;
        job_index(lab.core, young);
        job_enqueue(lab.core, young);
        int64_t first = heap_least(&lab.users[0]->ready)->order;
        CHECK(minute < 9 ? first == young->id : minute < 10 || first == old->id);
        if (first == young->id) {
            heap_pop(&lab.users[0]->ready);
            job_forget(lab.core, young);
        }
    }
    core_free(lab.core);
}


/* Two users that submit in turn: all of one's ids are odd. */
TEST(a_users_list_of_jobs_has_no_more_gone_than_there_are_whatever_their_ids)
{
    enum { JOBS = 2000, STAY = 20, FEW = 32 };
    struct user user = { .job_count = 0 };
    struct job *jobs = calloc(JOBS, sizeof *jobs);

    CHECK(jobs != NULL);
    for (int i = 0; i < JOBS; i++) {
        jobs[i].id = 2 * i + 1;
        user_add_job(&user, &jobs[i]);
    }
    for (int i = 0; i < JOBS - STAY; i++) {
        user_drop_job(&user, &jobs[i]);
        CHECK(user.job_count <= 2 * (size_t)(JOBS - 1 - i) || user.job_count < FEW);
    }
    for (int i = JOBS - STAY; i < JOBS; i++) {
        size_t at = user_seek(&user, jobs[i].id - 1);

        while (at < user.job_count && user.jobs[at] == NULL)
            at++;
        CHECK(at < user.job_count && user.jobs[at] == &jobs[i]);
    }
    free(user.jobs);
    free(jobs);
}
