/* The bare loop that the servo's punctuality is measured against: sleep until an absolute
 * deadline, note how late it woke, nothing else.
 *
 * usage: loop PERIOD_NS CYCLES PRIORITY   (priority 0: the ordinary scheduler)
 * prints one lateness in nanoseconds a line; deadlines that have passed are skipped and counted
 * as "missed N" on the last line. */
#define _GNU_SOURCE
#include <errno.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <time.h>

static long long now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}

int main(int argc, char **argv)
{
    if (argc != 4)
        return 2;
    long long period = atoll(argv[1]), cycles = atoll(argv[2]), missed = 0;
    struct sched_param parameter = {.sched_priority = atoi(argv[3])};
    long long *lateness = calloc(cycles, sizeof *lateness);
    if (!lateness)
        return 1;
    prctl(PR_SET_TIMERSLACK, 1, 0, 0, 0);
    mlockall(MCL_CURRENT | MCL_FUTURE);
    if (parameter.sched_priority && sched_setscheduler(0, SCHED_FIFO, &parameter))
        return 3;
    long long deadline = now_ns() + period;
    for (long long k = 0; k < cycles; k++) {
        struct timespec t = {deadline / 1000000000LL, deadline % 1000000000LL};
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL) == EINTR)
            ;
        long long done = now_ns();
        lateness[k] = done - deadline;
        deadline += period;
        if (done > deadline) {
            long long skipped = (done - deadline) / period + 1;
            missed += skipped;
            deadline += skipped * period;
        }
    }
    for (long long k = 0; k < cycles; k++)
        printf("%lld\n", lateness[k]);
    printf("missed %lld\n", missed);
    return 0;
}
