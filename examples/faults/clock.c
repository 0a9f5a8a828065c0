/* Preloaded into the daemon by the campaign: the wall clock is off by as many seconds as the file named by FAULTS_CLOCK says. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

int clock_gettime(clockid_t clock, struct timespec *now) {
    static int (*real)(clockid_t, struct timespec *);
    char text[32] = {0};
    const char *path;
    int file, rc;
    if (!real) real = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
    rc = real(clock, now);
    if (rc || clock != CLOCK_REALTIME || !(path = getenv("FAULTS_CLOCK"))) return rc;
    file = open(path, O_RDONLY | O_CLOEXEC);
    if (file < 0) return rc;
    if (read(file, text, sizeof text - 1) > 0) now->tv_sec += strtoll(text, NULL, 10);
    close(file);
    return rc;
}
