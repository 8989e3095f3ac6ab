/* pilot.h - the messages between the broker and its workers
 *
 * A worker is a ZeroMQ DEALER that connects to the broker's ROUTER for workers (ipc on this host; CURVE with the role
 * `worker` from others).  A message is 3 to 5 frames: version "MDW1", verb, header (a JSON object), payload frames.
 *
 *     from the worker
 *     READY      {"pid", "version", "core", "credit_unit"}        idle: one job may be sent; also after each DONE or FAIL
 *     HEARTBEAT  {"job", "attempt", "rss_bytes", "cpu_s"}         every `heartbeat_s`, working or not (job null)
 *     PROGRESS   {"job", "attempt", "event": {"fraction", ...}}   at most ten a second; may be dropped
 *     OUTPUT     {"job", "attempt", "shape": SHAPE}               a batch follows (simulate), as DATA of "output"
 *     DATA       {"job", "attempt", "of": "output"|"result", "offset", "crc"}  + bytes, at most PILOT_DATA_MOST; in order, within credit
 *     DONE       {"job", "attempt", "cpu_s", "peak_bytes", "result_bytes", "output_bytes"}  + the result's text, where result_bytes <=
 *                PILOT_RESULT_MOST; a longer one came as DATA of "result"
 *     FAIL       {"job", "attempt", "cpu_s", "peak_bytes", "error": {"code", "message", "field"}}
 *
 *     from the broker
 *     JOB        {"job", "attempt", "kind", "options", "input": INPUT, "credit", "run_limit_s"}  + the input's data where INPUT has no path
 *     CREDIT     {"job", "attempt", "bytes"}                      so many more bytes of DATA may be sent
 *     STOP       {}                                               end when idle
 *
 *     SHAPE  {"type": "batch", "samples", "channels", "dt", "period"|null, "units"|null, "names": [...]|null, "attributes": {...}|null}
 *            {"type": "scene", "length"}
 *     INPUT  {"shape": SHAPE, "sha256", "crc", "path", "offset"}  path, offset: the sealed file of the spool, mapped; absent: in the payload
 *
 * `job` is a decimal string (64-bit), `crc` a number (CRC-32C).  An attempt fences: what names another (job, attempt) than
 * the one the broker gave this worker is dropped.
 */
#ifndef WIRE_PILOT_H
#define WIRE_PILOT_H

#define PILOT_VERSION "MDW1"
enum {
    PILOT_DATA_MOST = 256 * 1024,
    PILOT_RESULT_MOST = 256 * 1024,
    PILOT_CREDIT = 4 * 1024 * 1024,   /* what JOB gives when the broker says nothing else */
    PILOT_FRAMES_MOST = 5,
};

enum pilot_verb {
    PILOT_READY, PILOT_HEARTBEAT, PILOT_PROGRESS, PILOT_OUTPUT, PILOT_DATA, PILOT_DONE, PILOT_FAIL,
    PILOT_JOB, PILOT_CREDIT_MORE, PILOT_STOP, PILOT_VERB_COUNT
};

/*
 * How a worker is started: modald-worker --connect ENDPOINT [--user NAME] [--heartbeat S] [--memory BYTES] [--cpu S]
 * [--sandbox on|off].  Its environment is emptied but for PATH, LANG, OPENBLAS_*; its stderr is a pipe of the broker's.  It
 * ends with its parent, on SIGTERM, and 0 after STOP.
 */
#endif
