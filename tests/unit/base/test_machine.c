/* test_machine.c - what a worker may have where nobody said how much */
#include "check.h"
#include <unistd.h>
#include "base/machine.h"

TEST(there_is_no_more_memory_for_us_than_the_machine_has)
{
    const int64_t physical = (int64_t)sysconf(_SC_PHYS_PAGES) * sysconf(_SC_PAGESIZE);

    CHECK(machine_memory() > 0 && machine_memory() <= physical);
}

TEST(workers_have_equal_parts_the_daemon_one_too_and_no_worker_less_than_a_gibibyte)
{
    const int64_t gib = INT64_C(1) << 30;

    CHECK(machine_worker_memory(16 * gib, 3) == 4 * gib);
    CHECK(machine_worker_memory(64 * gib, 7) == 8 * gib);
    CHECK(machine_worker_memory(6 * gib, 7) == gib);
    CHECK(machine_worker_memory(6 * gib, 0) == 6 * gib);
}
