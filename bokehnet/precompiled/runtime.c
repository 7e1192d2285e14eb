/* What compiled kernels need beside the C library: memory of arrays that they make, and threads for their loops.
 *
 * Names and arguments are those under which numba's code asks for these things. */

#include <pthread.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* The oldest versions of these functions, so that the library loads also with C libraries since 2.29. */
__asm__(".symver pthread_create, pthread_create@GLIBC_2.2.5");
__asm__(".symver pthread_join, pthread_join@GLIBC_2.2.5");

__asm__(".symver oldest_hypot, hypot@GLIBC_2.2.5");
double oldest_hypot(double, double);
double hypot(double x, double y) { return oldest_hypot(x, y); }

#define PUBLIC __attribute__((visibility("default")))

/* PROCESSOR, the class that the kernels were made for, is given to the compiler. */
PUBLIC int bokehnet_fits(void) { return __builtin_cpu_supports(PROCESSOR) != 0; }

/* ---- Memory: an array's owner counts who holds it, and goes with the last one. ---- */

typedef struct {
    size_t held;
    void *destructor, *destructor_data, *data;
    size_t size;
    void *allocator;
} Owner;

void *NRT_MemInfo_alloc_aligned(size_t size, uint32_t alignment)
{
    size_t lost = sizeof(Owner) + alignment;
    Owner *owner = size > SIZE_MAX - lost ? NULL : malloc(size + lost);
    if (!owner)
        return NULL;
    uintptr_t data = (uintptr_t)(owner + 1);
    if (alignment > 1)
        data += (alignment - data % alignment) % alignment;
    *owner = (Owner){.held = 1, .data = (void *)data, .size = size};
    return owner;
}

void *NRT_MemInfo_alloc_safe_aligned(size_t size, uint32_t alignment)
{
    return NRT_MemInfo_alloc_aligned(size, alignment);
}

void *NRT_MemInfo_alloc(size_t size) { return NRT_MemInfo_alloc_aligned(size, 0); }
void NRT_MemInfo_call_dtor(Owner *owner) { free(owner); }
PUBLIC void bokehnet_release(Owner *owner)
{
    if (owner && --owner->held == 0)
        free(owner);
}
void *NRT_Allocate(size_t size) { return malloc(size); }
void NRT_Free(void *block) { free(block); }

/* Strides of a reshaped array in C order; 0 unless the array lies without gaps in that order. */
int numba_attempt_nocopy_reshape(intptr_t axes, const intptr_t *shape, const intptr_t *strides, intptr_t new_axes,
                                 const intptr_t *new_shape, intptr_t *new_strides, intptr_t item, int fortran)
{
    intptr_t step = item;
    for (intptr_t axis = axes - 1; axis >= 0; axis--) {
        if (shape[axis] > 1 && strides[axis] != step)
            return 0;
        step *= shape[axis];
    }
    if (fortran && new_axes > 1)
        return 0;
    step = item;
    for (intptr_t axis = new_axes - 1; axis >= 0; axis--) {
        new_strides[axis] = step;
        step *= new_shape[axis];
    }
    return 1;
}

/* ---- Python, of which kernels want its lock and, in a thread that fails, its exceptions: there is none here.
 * That a thread has failed is kept for the caller to ask. ---- */

static _Thread_local int failed = 0;

void *PyExc_RuntimeError, *PyExc_StopIteration, *PyExc_SystemError;

int numba_gil_ensure(void) { return 0; }
void numba_gil_release(int state) { (void)state; }
void *PyEval_SaveThread(void) { return NULL; }
void PyEval_RestoreThread(void *state) { (void)state; }
void PyErr_Clear(void) {}
void PyErr_SetNone(void *kind) { (void)kind, failed = 1; }
void PyErr_SetString(void *kind, const char *text) { (void)kind, (void)text, failed = 1; }
int numba_do_raise(void *exception) { (void)exception; return !(failed = 1); }
void *numba_unpickle(void *data, int size, void *hash) { (void)data, (void)size, (void)hash, failed = 1; return NULL; }
void *numba_runtime_build_excinfo_struct(void *text, void *arguments) { (void)text, (void)arguments, failed = 1; return NULL; }
void *PyBytes_FromStringAndSize(const char *text, intptr_t size) { (void)text, (void)size; return NULL; }
intptr_t PyObject_Hash(void *object) { (void)object; return 0; }
void *PyTuple_Pack(intptr_t size, ...) { (void)size; return NULL; }
void *PyUnicode_FromKindAndData(int kind, const void *text, intptr_t size) { (void)kind, (void)text, (void)size; return NULL; }

/* Whether a thread of the region that ended last has failed. */
PUBLIC int bokehnet_failed(void) { return failed; }

/* ---- Threads: those that a region needs are started with it; the caller takes the first share. ---- */

enum { MOST_THREADS = 256 };

static _Thread_local size_t threads = 1, thread_id = 0, chunk_size = 0;

PUBLIC void bokehnet_set_threads(int wanted)
{
    threads = wanted < 1 ? 1 : wanted > MOST_THREADS ? MOST_THREADS : (size_t)wanted;
    thread_id = 0;
    failed = 0;
}
size_t get_num_threads(void) { return threads; }
size_t get_thread_id(void) { return thread_id; }
size_t get_parallel_chunksize(void) { return chunk_size; }
void set_parallel_chunksize(size_t size) { chunk_size = size; }

/* A schedule: for each share the first indices of all axes, then the last ones; the longest axis is parted. */
size_t get_sched_size(size_t wanted, size_t axes, intptr_t *first, intptr_t *last)
{
    (void)axes, (void)first, (void)last;
    return wanted;
}
intptr_t *allocate_sched(size_t size) { return malloc(size * sizeof(intptr_t)); }
void deallocate_sched(intptr_t *schedule) { free(schedule); }

void do_scheduling_signed(size_t axes, intptr_t *first, intptr_t *last, size_t shares, intptr_t *schedule,
                          intptr_t debug)
{
    size_t parted = 0;
    (void)debug;
    for (size_t axis = 1; axis < axes; axis++)
        if (last[axis] - first[axis] > last[parted] - first[parted])
            parted = axis;
    intptr_t length = last[parted] - first[parted] + 1, count = (intptr_t)shares;
    if (length < 0)
        length = 0;
    for (intptr_t share = 0; share < count; share++, schedule += 2 * axes) {
        memcpy(schedule, first, axes * sizeof(intptr_t));
        memcpy(schedule + axes, last, axes * sizeof(intptr_t));
        schedule[parted] = first[parted] + length * share / count;
        schedule[axes + parted] = first[parted] + length * (share + 1) / count - 1;
    }
}
void do_scheduling_unsigned(size_t axes, intptr_t *first, intptr_t *last, size_t shares, intptr_t *schedule,
                            intptr_t debug)
{
    do_scheduling_signed(axes, first, last, shares, schedule, debug);
}

typedef void Loop(char **arrays, size_t *sizes, size_t *steps, void *data);

typedef struct {
    Loop *loop;
    char **arrays;
    size_t *sizes, *steps, number;
    int failed;
    void *data;
} Share;

static void *run_share(void *given)
{
    Share *share = given;
    size_t outer_threads = threads, outer_id = thread_id;
    int outer_failed = failed;
    threads = 1, thread_id = share->number, failed = 0; /* a region inside a region has this thread alone */
    if (share->sizes[0])
        share->loop(share->arrays, share->sizes, share->steps, share->data);
    share->failed = failed;
    threads = outer_threads, thread_id = outer_id, failed = outer_failed;
    return NULL;
}

void numba_parallel_for(Loop *loop, char **arrays, size_t *sizes, size_t *steps, void *data, size_t inner_sizes,
                        size_t array_count, int wanted)
{
    size_t count = wanted < 1 ? 1 : (size_t)wanted;
    Share *shares = malloc(count * sizeof(Share));
    char **all_arrays = malloc(count * array_count * sizeof(char *)), *is_started = calloc(count, 1);
    size_t *all_sizes = malloc(count * (inner_sizes + 1) * sizeof(size_t));
    pthread_t *started = malloc(count * sizeof(pthread_t));
    if (!shares || !all_arrays || !is_started || !all_sizes || !started) {
        failed = 1;
        count = 0;
    }
    for (size_t number = 0; number < count; number++) {
        Share *share = &shares[number];
        size_t begin = sizes[0] * number / count, end = sizes[0] * (number + 1) / count;
        share->arrays = all_arrays + number * array_count, share->sizes = all_sizes + number * (inner_sizes + 1);
        share->loop = loop, share->steps = steps, share->data = data;
        share->number = number;
        memcpy(share->sizes, sizes, (inner_sizes + 1) * sizeof(size_t));
        share->sizes[0] = end - begin;
        for (size_t array = 0; array < array_count; array++)
            share->arrays[array] = arrays[array] + steps[array] * begin;
        if (number)
            is_started[number] = pthread_create(&started[number], NULL, run_share, share) == 0;
    }
    for (size_t number = 0; number < count; number++) {
        if (is_started[number])
            pthread_join(started[number], NULL);
        else
            run_share(&shares[number]);
        failed |= shares[number].failed;
    }
    free(started), free(all_sizes), free(is_started), free(all_arrays), free(shares);
}
