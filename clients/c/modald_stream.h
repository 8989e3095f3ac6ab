/* modald_stream.h - three lines in a running simulation: its samples to modald, damping back
 *
 *     modald_stream *s = modald_open("rig7", 3, dt);      before the loop
 *         modald_push(s, y);                              in it: copies 3 doubles, nothing else
 *     modald_close(s);                                    after it
 *
 * Without $MODALD_URL every call does nothing, so that the lines stay in the code.  No call returns
 * an error to be checked, NULL is a legal stream everywhere, nothing is ever printed on stdout, and
 * the host is never stopped, forked or ended: when the daemon is away or slow, samples wait in a
 * ring, then in a spill file, and past that are counted as a gap.  modald_push makes no system call
 * and takes no lock.  One thread pushes to a stream; streams are independent, and may be as many as
 * there are simulations: those of a process to one endpoint with one key file share a connection
 * and a sending thread (three threads in all, two of them libzmq's), and one that the sender keeps
 * up with costs 1 to 2 MB.  Samples leave 50 ms after the first of them was pushed, once all before
 * are acknowledged, or as soon as 64 KiB are there.  In a child that the host forks its streams do
 * nothing, and need not be closed; a closed stream is like none.  The sending thread has its own
 * descriptors and takes no signals; paths and all of the environment are read at modald_open.
 *
 * Environment:
 *   MODALD_URL        the daemon's endpoint; unset: no-op
 *   MODALD_KEYFILE    CURVE keys (needed unless the daemon has none)
 *   MODALD_RING       bytes of a stream's ring, default 8388608: of one in memory 1 MiB is taken at
 *                     first, more as samples wait, and given back a second after that
 *   MODALD_RING_FILE  keep the ring in this file (%s: the stream's name), so that a killed run's
 *                     last samples are sent by the next one, or by `modalctl replay` (in /dev/shm,
 *                     where the kernel need not mark pages before they are written back to a disk)
 *   MODALD_SPILL      folder of spill files, default $TMPDIR or /tmp
 *   MODALD_SPILL_MAX  bytes of a spill file, default 1073741824; 0: none
 *   MODALD_CLOSE_WAIT seconds that modald_close may take, default 5
 *   MODALD_WINDOW, MODALD_HOP  samples of a live window and between two, defaults the daemon's
 *   MODALD_OPTIONS    identify's options for the windows, a JSON object
 *   MODALD_ALARMS     rules over the windows' modes, a JSON object: proto/PROTOCOL.md, section 11
 *
 * Push accepted steps only: after isTimeWindowComplete (preCICE), after a step that will not be
 * rolled back (FMI), after Newmark's iterations have converged.
 */
#ifndef MODALD_STREAM_H
#define MODALD_STREAM_H
#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct modald_stream modald_stream;

enum { MODALD_UNKNOWN = 0, MODALD_STABLE = 1, MODALD_UNSTABLE = 2, MODALD_UNDECIDED = 3 };

/* The least damped mode of the last window. */
struct modald_estimate {
    double frequency_hz;
    double frequency_std;       /* standard deviation; negative: not known */
    double damping_ratio;       /* positive decays */
    double damping_std;         /* standard deviation; negative: not known */
    double sample;              /* index of the last sample it rests on */
};

/* Counts of samples. */
struct modald_report {
    double pushed, acknowledged, dropped, waiting, spilled;
    double resampling_error;    /* of modald_push_at: the largest, relative to a channel's rms */
    double refused;             /* 1: the daemon does not want it, the run goes on without */
};

/* Begin a stream of CHANNELS, 1 to 65536, a sample every DT seconds, under NAME, 1 to 128 bytes.
 * NULL where there is nothing to do or no memory; the end of it is modald_close. */
modald_stream *modald_open(const char *name, int channels, double dt);

/* Optional, before the first push: the NAMES of the channels, the UNITS they share (each may be
 * NULL), the PERIOD of a periodic system in seconds, or 0. */
void modald_describe(modald_stream *s, const char *const *names, const char *units, double period);

/* Optional, before the first push: live windows of SAMPLES every HOP, identified with OPTIONS (a
 * JSON object, or NULL). */
void modald_window(modald_stream *s, long samples, long hop, const char *options);

/* Optional, before the first push: RULES over the windows' modes, a JSON object
 * (proto/PROTOCOL.md, section 11), in place of MODALD_ALARMS. */
void modald_alarms(modald_stream *s, const char *rules);

/* The INDEX that the next push has, for a run that continues from a checkpoint; the same index
 * again is a repeat. */
void modald_seek(modald_stream *s, double index);

/* Push one sample: Y has a value a channel, and is the host's again at once. */
void modald_push(modald_stream *s, const double *y);

/* Push COUNT samples, one behind the other. */
void modald_push_block(modald_stream *s, const double *y, size_t count);

/* The same as modald_push, of single precision. */
void modald_push_float(modald_stream *s, const float *y);

/* Push a sample at time T [s], steps uneven: brought to multiples of dt by cubic interpolation, its
 * error estimated.  A time before the last begins anew there. */
void modald_push_at(modald_stream *s, double t, const double *y);

/* What the last window said: one atomic load; MODALD_UNKNOWN until the first window and whenever
 * the link is broken.  Advice, not an order. */
int modald_verdict(const modald_stream *s);

/* 1 and *OUT filled, or 0 while nothing is known. */
int modald_get_estimate(const modald_stream *s, struct modald_estimate *out);

/* How many samples are where, into *OUT; all 0 without a stream. */
void modald_get_report(const modald_stream *s, struct modald_report *out);

/* Send what is left, seal, free; at most $MODALD_CLOSE_WAIT seconds.  What could not be sent stays
 * in the spill file.  Where that time passed for a stream and the daemon took nothing meanwhile,
 * the next that are closed do not wait for it, as long again. */
void modald_close(modald_stream *s);

/* The same for COUNT streams at once, each of them once, any of them NULL: all are sent, sealed and
 * synced together, and waited for together, where one after the other each has its own syncs. */
void modald_close_all(modald_stream *const *streams, size_t count);

/* The same for a run that was broken off: the record says so. */
void modald_abandon(modald_stream *s);

/* Send a spill or ring file, in at most TIMEOUT seconds: 1 all of it acknowledged, 0 not and a
 * reason into MESSAGE of SIZE bytes; *SAMPLES is how many were.  What a killed host was writing is
 * torn, and records that are not what was written are passed over and leave a gap: then 1 too, and
 * MESSAGE says how much.  For modalctl replay. */
int modald_replay(const char *path, double timeout, double *samples, char *message, size_t size);

#ifdef __cplusplus
}
#endif
#endif
