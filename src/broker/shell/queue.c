/* queue.c - see queue.h */
#include "broker/shell/queue.h"
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

bool done_open(struct done_queue *queue)
{
    memset(queue, 0, sizeof *queue);
    pthread_mutex_init(&queue->mutex, NULL);
    queue->transactions_end = &queue->transactions;
    queue->tasks_end = &queue->tasks;
    queue->wake = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    return queue->wake >= 0;
}

void done_close(struct done_queue *queue)
{
    if (queue->wake >= 0)
        close(queue->wake);
    pthread_mutex_destroy(&queue->mutex);
}

static void unlock_and_wake(struct done_queue *queue)
{
    uint64_t one = 1;

    pthread_mutex_unlock(&queue->mutex);
    if (write(queue->wake, &one, sizeof one) < 0)
        return;                                  /* it is readable already */
}

void done_transactions(struct done_queue *queue, struct transaction *first)
{
    pthread_mutex_lock(&queue->mutex);
    *queue->transactions_end = first;
    while (*queue->transactions_end != NULL)
        queue->transactions_end = &(*queue->transactions_end)->next;
    unlock_and_wake(queue);
}

void done_task(struct done_queue *queue, struct task *task)
{
    pthread_mutex_lock(&queue->mutex);
    task->next = NULL;
    *queue->tasks_end = task;
    queue->tasks_end = &task->next;
    unlock_and_wake(queue);
}

void done_ping(struct done_queue *queue)
{
    pthread_mutex_lock(&queue->mutex);
    queue->pinged = true;
    unlock_and_wake(queue);
}

void done_stuck(struct done_queue *queue)
{
    pthread_mutex_lock(&queue->mutex);
    queue->stuck = true;
    unlock_and_wake(queue);
}

void done_fatal(struct done_queue *queue, const struct modal_error *err)
{
    pthread_mutex_lock(&queue->mutex);
    if (!queue->fatal)
        queue->error = *err;
    queue->fatal = true;
    unlock_and_wake(queue);
}

void done_take(struct done_queue *queue, struct transaction **transactions, struct task **tasks,
               bool *pinged, bool *stuck, bool *fatal)
{
    uint64_t count;

    if (read(queue->wake, &count, sizeof count) < 0)
        count = 0;
    pthread_mutex_lock(&queue->mutex);
    *transactions = queue->transactions;
    *tasks = queue->tasks;
    *pinged = queue->pinged;
    *stuck = queue->stuck;
    *fatal = queue->fatal;
    queue->transactions = NULL;
    queue->transactions_end = &queue->transactions;
    queue->tasks = NULL;
    queue->tasks_end = &queue->tasks;
    queue->pinged = queue->stuck = false;
    pthread_mutex_unlock(&queue->mutex);
}
