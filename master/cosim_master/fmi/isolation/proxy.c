/* The master's side of isolated FMUs: exports FMI functions that make their calls in the process of the FMU.

   An instance is a struct of this library; the master uses its address as the FMU's handle. In Step Mode, calls that set
   values are kept until the next step, and travel with it. The calls that have read outputs after an earlier step travel
   with it, too, and are answered from its reply. A step is therefore one round trip, however many values it exchanges.

   A master that has the inputs of several instances may begin their steps before it makes any (isolated_begin_XXX, then
   isolated_post): all that share a process are then one round trip, and processes run at the same time. The step itself
   then only waits for the reply.

   If the process ends or does not return in time, every later call of its instances returns fatal, unless it may be
   started anew (restart.h). It may be on another machine (remote.h), or be connected by a socket here, as always where
   memory cannot be shared (system.h). */

#define _GNU_SOURCE
#include "system.h"

#include "channel.h"

#include <math.h>
#include <stdlib.h>

#define ERROR 3
#define DISCARD 2
#define MOST_KNOWN 64
#define OUTPUT_BYTES 8192
#define FIRST_SLICE 1000000   /* ns */
#define LONGEST_SLICE 8000000 /* ns */

typedef struct {
    char *data;
    size_t used, room;
} Buffer;

typedef struct {
    size_t begin, size;          /* of its operation, in `reads` */
    size_t answer, answer_bytes; /* in `answers`; 0 bytes: the FMU has not been asked */
} Read;

typedef enum { ALIVE, SIGNALLED, EXITED, TIMED_OUT, BROKEN, DIFFERENT, LOST } End;
typedef enum { IDLE, BEGUN, ANSWERED } Progress;

typedef struct Channel Channel;

typedef struct Instance {
    Channel *channel;
    struct Instance *next;
    uint64_t handle, number;
    int fmi, made;
    bool cosimulation, stepping, after_step;
    double time; /* reached by its steps, s; NAN before the first one */
    void *logger, *environment;
    char *name;
    Buffer sets, reads, answers, texts, operation;
    unsigned n_sets, n_reads, next_read;
    unsigned first, n_operations; /* the numbers of its operations in the request that is under way */
    Progress begun;
    Buffer early; /* the answers to a step that was begun */
    unsigned n_early;
    Read known[MOST_KNOWN];
    int set_failed, set_status; /* 1 + number of the function; status of a deferred call that has failed */
} Instance;

struct Channel {
    char *memory;
    size_t mapped;
    int file, process, output, pid;
    int socket; /* to the machine of the process, or to the process itself; -1: it shares memory */
    bool direct; /* the socket is that of the process (portable.c), whose calls have to be limited here */
    int master; /* the socket to the master, if that is on another machine; -1: it is here */
    int64_t pulsed; /* when the master was last told that the process is busy, ns */
    double limit, patience; /* s; 0: none. `patience` is the limit of calls other than those of Step Mode. */
    Instance *instances;
    uint64_t numbers;
    Buffer request;        /* operations of the request that is being written or under way */
    unsigned n_operations; /* in it */
    Buffer begun;          /* pointers to the instances whose steps are in it */
    bool posted;
    End end;
    int end_number;         /* the signal, the exit code, or the errno of a lost connection */
    unsigned end_function;  /* 1 + number of the function that was called */
    uint64_t end_owner, end_memory;
    char lines[OUTPUT_BYTES]; /* the last bytes that the process has written to stdout and stderr */
    size_t n_lines;
    int most_restarts, restarts; /* the first is 0 unless isolated_restart_by was called; for the others: restart.h */
    unsigned every, n_since;     /* requests: between two states kept, since the last ones */
    bool keeps, unkept;
    volatile bool given_up;
    bool (*start_anew)(void);
    Buffer start, since, made, states, kept;
};

static Header *header(Channel *c) { return (Header *)c->memory; }

static bool reserve(Buffer *b, size_t more) {
    if (b->used + more <= b->room) return true;
    size_t room = b->room ? b->room : 256;
    while (room < b->used + more) room *= 2;
    char *data = realloc(b->data, room);
    if (data == NULL) return false;
    b->data = data, b->room = room;
    return true;
}

static bool append(Buffer *b, const void *data, size_t bytes) {
    size_t whole = padded(bytes);
    if (!reserve(b, whole)) return false;
    if (bytes) memcpy(b->data + b->used, data, bytes);
    memset(b->data + b->used + bytes, 0, whole - bytes);
    b->used += whole;
    return true;
}

static bool append_number(Buffer *b, uint64_t number) { return append(b, &number, 8); }

/* ---- the process ------------------------------------------------------------------------------------------------- */

static void read_output(Channel *c) {
    char block[4096];
    for (;;) {
        int n = read_some(c->output, block, sizeof block);
        if (n <= 0) return;
        size_t kept = c->n_lines + (size_t)n > OUTPUT_BYTES ? OUTPUT_BYTES - (size_t)n : c->n_lines;
        memmove(c->lines, c->lines + c->n_lines - kept, kept);
        memcpy(c->lines + kept, block, (size_t)n);
        c->n_lines = kept + (size_t)n;
    }
}

#if SHARES
static void found_dead(Channel *c) {
    siginfo_t info;
    memset(&info, 0, sizeof info);
    Header *h = header(c);
    c->end_function = h->running <= N_FUNCTIONS ? h->running : 0, c->end_owner = h->owner, c->end_memory = h->memory;
    c->end = BROKEN;
    if (waitid(P_PID, (id_t)c->pid, &info, WEXITED | WNOWAIT) == 0) {
        c->end = info.si_code == CLD_EXITED ? EXITED : SIGNALLED;
        c->end_number = info.si_status;
    }
    read_output(c);
}
#endif

static void end_by(Channel *c, End end) {
    if (c->socket >= 0) {
        hang_up(c->socket); /* which ends the process */
        c->end = end;
        return;
    }
#if SHARES
    Header *h = header(c);
    c->end_function = h->running <= N_FUNCTIONS ? h->running : 0, c->end_owner = h->owner;
    kill(c->pid, SIGKILL);
    siginfo_t info;
    waitid(P_PID, (id_t)c->pid, &info, WEXITED | WNOWAIT);
    read_output(c);
    c->end = end;
#endif
}

static bool map(Channel *c, size_t least);
static bool receive_reply(Channel *c);
static bool readable(Channel *c, double limit);
#if SHARES
static bool pulse(Channel *c);
#endif

/* Waits until the process hands over; returns false, with `end`, if it never will. The time during which this process
   was stopped does not count. */
static bool wait_for_turn(Channel *c, double limit) {
    if (c->direct && !readable(c, limit)) return end_by(c, TIMED_OUT), false;
    if (c->socket >= 0) return receive_reply(c); /* the other machine has the time limit */
#if SHARES
    uint32_t *turn = &header(c)->turn;
    int64_t slice = FIRST_SLICE, waited = 0, began = 0;
    uint32_t executed = 0;
    while (__atomic_load_n(turn, __ATOMIC_ACQUIRE) != OF_MASTER) {
        struct timespec pause = {0, slice};
        long done = syscall(SYS_futex, turn, FUTEX_WAIT, OF_FMU, &pause, NULL, 0);
        if (done == 0 || errno == EAGAIN || __atomic_load_n(turn, __ATOMIC_ACQUIRE) == OF_MASTER) continue;
        int64_t at = now(), passed = began ? at - began : slice;
        began = at;
        uint32_t now_executed = __atomic_load_n(&header(c)->executed, __ATOMIC_ACQUIRE);
        waited = now_executed == executed ? waited + (passed < 4 * slice ? passed : slice) : 0; /* of one call */
        executed = now_executed;
        read_output(c);
        struct pollfd process = {c->process, POLLIN, 0};
        if (poll(&process, 1, 0) > 0 && __atomic_load_n(turn, __ATOMIC_ACQUIRE) != OF_MASTER) {
            found_dead(c);
            return false;
        }
        if (limit > 0 && (double)waited > limit * 1e9) {
            end_by(c, TIMED_OUT);
            return false;
        }
        if (c->master >= 0 && !pulse(c)) {
            end_by(c, BROKEN);
            return false;
        }
        slice = 2 * slice < LONGEST_SLICE ? 2 * slice : LONGEST_SLICE;
    }
#endif
    return true;
}

#if SHARES
/* Follows the size of the shared file, which either side may have lengthened. */
static bool map(Channel *c, size_t least) {
    Header *h = header(c);
    if (h->size < least) {
        uint64_t size = h->size;
        while (size < least) size *= 2;
        if (size > LARGEST || ftruncate(c->file, (off_t)size) != 0) return false;
        h->size = size;
    }
    uint64_t size = h->size;
    if (size <= c->mapped) return true;
    if (size > LARGEST) return false;
    void *memory = mremap(c->memory, c->mapped, size, MREMAP_MAYMOVE);
    if (memory == MAP_FAILED) return false;
    c->memory = memory, c->mapped = size;
    return true;
}
#else
static bool map(Channel *c, size_t least) {
    size_t size = c->mapped;
    while (size < least) size *= 2;
    if (size == c->mapped) return true;
    char *memory = size > LARGEST ? NULL : realloc(c->memory, size);
    if (memory == NULL) return false;
    memset(memory + c->mapped, 0, size - c->mapped);
    c->memory = memory, c->mapped = size;
    return true;
}
#endif

typedef void (*Logger2)(void *, const char *, int, const char *, const char *, ...);
typedef void (*Logger3)(void *, int, const char *, const char *);

static void pass_log_on(Channel *c) {
    Header *h = header(c);
    size_t used = h->log <= LOG_BYTES ? h->log : 0;
    if (used == 0) return;
    char *copy = malloc(used); /* the logger may call back into Python, which may use this channel */
    if (copy == NULL) return;
    memcpy(copy, c->memory + HEADER_BYTES, used);
    h->log = 0;
    for (size_t at = 0; at + sizeof(Entry) <= used;) {
        Entry *e = (Entry *)(copy + at);
        if (e->size < sizeof(Entry) + e->category + 1 || e->size > used - at) break;
        const char *category = (char *)(e + 1), *message = category + e->category;
        copy[at + e->size - 1] = 0;
        for (Instance *i = c->instances; i != NULL; i = i->next) {
            if (i->number != e->owner || i->logger == NULL) continue;
            if (i->fmi == 2) ((Logger2)i->logger)(i->environment, i->name, e->status, category, message);
            else ((Logger3)i->logger)(i->environment, e->status, category, message);
        }
        at += e->size;
    }
    free(copy);
}

static void wake(Channel *c) {
#if SHARES
    __atomic_store_n(&header(c)->turn, OF_FMU, __ATOMIC_RELEASE);
    syscall(SYS_futex, &header(c)->turn, FUTEX_WAKE, 1, NULL, NULL, 0);
#else
    (void)c;
#endif
}

static void translate(Channel *c, char *data, size_t bytes);
static bool send_request(Channel *c, size_t bytes, double limit);

/* Hands operations over to the process, each of which has to return within `limit`. */
static bool hand_over(Channel *c, const Buffer *operations, bool translated, double limit) {
    size_t bytes = operations->used;
    if (!map(c, MESSAGES + bytes + 4096)) return end_by(c, BROKEN), false;
    Header *h = header(c);
    memcpy(c->memory + MESSAGES, operations->data, bytes);
    if (translated) translate(c, c->memory + MESSAGES, bytes);
    h->request = bytes, h->executed = 0;
    if (c->socket >= 0) return send_request(c, bytes, limit);
    wake(c);
    return true;
}

/* ---- messages ---------------------------------------------------------------------------------------------------- */

static bool write_operation(Buffer *b, const Instance *i, unsigned number, const Value *values, bool after_step) {
    size_t begin = b->used;
    Operation head = {number, after_step, 0, i->handle, i->number};
    bool well = append(b, &head, sizeof head);
    const Argument *a = TABLE[number].arguments;
    for (int n = 0; a[n].type != A_END && well; n++) {
        switch (a[n].type) {
        case A_INT: well = append_number(b, (uint64_t)(int64_t)values[n].i); break;
        case A_BOOL: well = append_number(b, values[n].b); break;
        case A_SIZE:
        case A_HANDLE:
        case A_DOUBLE: well = append(b, &values[n], 8); break;
        default: well = append_number(b, 0);
        }
    }
    for (int n = 0; a[n].type != A_END && well; n++) {
        switch (a[n].type) {
        case A_IN:
        case A_PLACE: well = append(b, values[n].p, bytes_of(&a[n], values)); break;
        case A_TEXTS_IN: {
            char **texts = values[n].p;
            size_t total = 0, at = b->used + 8;
            for (size_t j = 0; j < values[a[n].count].z; j++) total += strlen(texts[j] ? texts[j] : "") + 1;
            well = append_number(b, total) && reserve(b, padded(total));
            if (!well) break;
            memset(b->data + at, 0, padded(total));
            for (size_t j = 0; j < values[a[n].count].z; j++) {
                size_t length = strlen(texts[j] ? texts[j] : "") + 1;
                memcpy(b->data + at, texts[j] ? texts[j] : "", length);
                at += length;
            }
            b->used += padded(total);
            break;
        }
        case A_BYTES_IN: {
            char **parts = values[n].p;
            size_t *sizes = values[n - 1].p;
            for (size_t j = 0; j < values[a[n].count].z && well; j++) well = append(b, parts[j], sizes[j]);
            break;
        }
        default: break;
        }
    }
    if (well) ((Operation *)(b->data + begin))->size = b->used - begin;
    else b->used = begin;
    return well;
}

/* Copies the values of an answer to the arguments of the caller; returns false if the answer is malformed. Texts and
   Binaries are left in memory of the instance, until its next call. */
static bool read_answer(Instance *i, unsigned number, const Value *values, const char *answer, size_t bytes) {
    const Argument *a = TABLE[number].arguments;
    size_t at = sizeof(Answer);
    for (int n = 0; a[n].type != A_END; n++) {
        if (a[n].type == A_OUT || a[n].type == A_PLACE) {
            size_t size = bytes_of(&a[n], values);
            if (size > bytes - at) return false;
            if (size) memcpy(values[n].p, answer + at, size);
            at += padded(size);
        } else if (a[n].type == A_TEXTS_OUT || a[n].type == A_BYTES_OUT) {
            uint64_t total;
            if (bytes - at < 8) return false;
            memcpy(&total, answer + at, 8);
            at += 8;
            if (total > bytes - at) return false;
            i->texts.used = 0;
            if (!append(&i->texts, answer + at, total)) return false;
            at += padded(total);
            char *text = i->texts.data, *end = text + total, **places = values[n].p;
            for (size_t j = 0; j < values[a[n].count].z; j++) {
                if (a[n].type == A_BYTES_OUT) {
                    size_t size = ((size_t *)values[n - 1].p)[j];
                    if (size > (size_t)(end - text)) return false;
                    places[j] = text, text += size;
                } else {
                    size_t length = strnlen(text, (size_t)(end - text));
                    if (length == (size_t)(end - text)) return false;
                    places[j] = text, text += length + 1;
                }
            }
        }
        if (at > bytes) return false;
    }
    return true;
}

/* The answers in a reply. */
typedef struct {
    const char *data;
    size_t at, end;
    unsigned left;
} Answers;

static Answers answers_of(Channel *c) {
    Answers all = {c->memory, reply_at(header(c)), c->mapped, header(c)->executed};
    return all;
}

/* Returns the next answer without passing it; NULL if there is none. */
static const Answer *peek(const Answers *a) {
    if (a->left == 0 || a->at > a->end || a->end - a->at < sizeof(Answer)) return NULL;
    const Answer *answer = (const Answer *)(a->data + a->at);
    return answer->size < sizeof(Answer) || answer->size > a->end - a->at ? NULL : answer;
}

static const Answer *next_answer(Answers *a) {
    const Answer *answer = peek(a);
    if (answer != NULL) a->at += answer->size, a->left--;
    return answer;
}

#define V (Value[])
#include "remote.h"
#include "restart.h"

/* Hands the request over to the process; `await_reply` waits for its reply, with the same limit. */
static bool post(Channel *c, double limit) {
    if (c->most_restarts && !keep_if_due(c)) return false;
    return c->posted = hand_over(c, &c->request, c->most_restarts > 0, limit);
}

/* Returns whether the reply has arrived. If the process has ended, the answers that it has written before can be read. */
static bool await_reply(Channel *c, double limit) {
    bool well = wait_for_turn(c, limit);
    if (well && !map(c, 0)) end_by(c, BROKEN), well = false;
    pass_log_on(c);
    if (c->most_restarts && (well || (well = again(c, limit)))) keep_request(c);
    c->posted = false, c->request.used = 0, c->n_operations = 0;
    return well;
}

static int broken(Channel *c) {
    if (c->end == ALIVE) end_by(c, BROKEN);
    return FATAL;
}

static bool reads_later(const Instance *i, unsigned number) { return TABLE[number].kind == STEP && i->cosimulation; }

/* Appends the deferred calls of an instance and one more to the request, in a step also the calls that read its outputs. */
static bool append_request(Instance *i, unsigned number, const Value *values) {
    Channel *c = i->channel;
    bool later = reads_later(i, number);
    i->first = c->n_operations, i->n_operations = i->n_sets + 1 + (later ? i->n_reads : 0);
    c->n_operations += i->n_operations;
    return append(&c->request, i->sets.data, i->sets.used) && write_operation(&c->request, i, number, values, false) &&
           (!later || append(&c->request, i->reads.data, i->reads.used));
}

/* Takes the answers to the operations of an instance in a request; returns the status of the call. */
static int take_answers(Instance *i, unsigned number, const Value *values, Answers *from) {
    Channel *c = i->channel;
    const Answer *answer = NULL;
    const Operation *set = (const Operation *)i->sets.data;
    unsigned n_sets = i->n_sets;
    i->n_sets = 0, i->sets.used = 0; /* which stay where they are */
    for (unsigned n = 0; n < n_sets; n++) {
        if ((answer = next_answer(from)) == NULL) return broken(c);
        if (answer->status > WARNING || answer->status < 0) {
            i->set_failed = 1 + (int)set->function, i->set_status = answer->status;
            return TABLE[number].kind == STEP && answer->status == DISCARD ? ERROR : answer->status;
        }
        set = (const Operation *)((const char *)set + set->size);
    }
    if ((answer = next_answer(from)) == NULL) return broken(c);
    int status = answer->status;
    if (!read_answer(i, number, values, (const char *)answer, answer->size)) return broken(c);
    if (!reads_later(i, number)) return status;

    i->answers.used = 0, i->next_read = 0;
    for (unsigned n = 0; n < i->n_reads; n++) {
        i->known[n].answer_bytes = 0;
        if ((answer = peek(from)) == NULL || answer->operation != i->first + n_sets + 1 + n) continue;
        next_answer(from);
        i->known[n].answer = i->answers.used, i->known[n].answer_bytes = answer->size;
        if (!append(&i->answers, answer, answer->size)) return broken(c);
    }
    return status;
}

/* Waits for the reply to the steps that were begun, and gives each instance its answers. */
static void collect(Channel *c) {
    Instance **begun = (Instance **)c->begun.data;
    size_t n_begun = c->begun.used / sizeof *begun, j = 0;
    if (n_begun == 0) return;
    if (c->posted || post(c, c->limit)) await_reply(c, c->limit);
    Answers all = answers_of(c);
    for (const Answer *answer; (answer = next_answer(&all)) != NULL;) {
        while (j < n_begun && answer->operation >= begun[j]->first + begun[j]->n_operations) j++;
        if (j == n_begun || !append(&begun[j]->early, answer, answer->size)) break;
        begun[j]->n_early++;
    }
    for (j = 0; j < n_begun; j++) begun[j]->begun = ANSWERED;
    c->begun.used = 0;
}

/* Sends the deferred calls of an instance and one more, in a step also the calls that read its outputs. */
static int send_all(Instance *i, unsigned number, const Value *values) {
    Channel *c = i->channel;
    collect(c);
    if (c->end != ALIVE) return FATAL;
    if (!append_request(i, number, values)) return broken(c);
    double limit = i->stepping ? c->limit : c->patience;
    if (!post(c, limit) || !await_reply(c, limit)) return FATAL;
    Answers all = answers_of(c);
    return take_answers(i, number, values, &all);
}

/* Begins a step; the call that makes it waits for its end. If it cannot begin now, that call makes all of it. */
static int begin(void *handle, unsigned number, const Value *values) {
    Instance *i = handle, **place = &i;
    Channel *c = i->channel;
    if (c->end != ALIVE || c->posted || !i->stepping || i->begun) return 0;
    if (!append_request(i, number, values) || !append(&c->begun, place, sizeof *place)) return broken(c);
    i->begun = BEGUN, i->early.used = 0, i->n_early = 0, i->time = values[0].d;
    return 0;
}

/* Returns the status of a step that was begun. */
static int finish(Instance *i, unsigned number, const Value *values) {
    if (i->begun == BEGUN) collect(i->channel);
    i->begun = IDLE;
    Answers own = {i->early.data, 0, i->early.used, i->n_early};
    return take_answers(i, number, values, &own);
}

/* Answers a call that reads outputs from the reply to the last step; returns false if that has no answer. */
static bool answered(Instance *i, unsigned number, const Value *values, int *status) {
    i->operation.used = 0;
    if (!write_operation(&i->operation, i, number, values, true)) return false;
    for (unsigned tried = 0; tried < i->n_reads; tried++) {
        unsigned n = i->next_read < i->n_reads ? i->next_read : 0;
        Read *read = &i->known[n];
        i->next_read = n + 1;
        if (read->size != i->operation.used || memcmp(i->reads.data + read->begin, i->operation.data, read->size))
            continue;
        if (read->answer_bytes == 0) return false;
        const Answer *answer = (const Answer *)(i->answers.data + read->answer);
        *status = answer->status;
        return read_answer(i, number, values, (const char *)answer, read->answer_bytes);
    }
    if (i->n_reads < MOST_KNOWN && append(&i->reads, i->operation.data, i->operation.used)) {
        Read new = {i->reads.used - i->operation.used, i->operation.used, 0, 0};
        i->known[i->n_reads++] = new;
    }
    return false;
}

static int forward(void *handle, unsigned number, Value *values) {
    Instance *i = handle;
    Channel *c = i->channel;
    Kind kind = TABLE[number].kind;
    int status;
    if (i->begun) {
        if (kind == SET) return 0; /* the step has it already */
        if (kind == STEP) {
            status = finish(i, number, values);
            i->after_step = status >= 0 && status <= WARNING;
            if (i->after_step) i->time = values[0].d + values[1].d;
            return status;
        }
        collect(c);
        i->begun = IDLE;
    }
    if (kind == GET && i->after_step && i->n_sets == 0 && answered(i, number, values, &status)) return status;
    if (c->end != ALIVE) return FATAL;
    if (kind == SET && i->stepping) {
        i->after_step = false;
        if (!write_operation(&i->sets, i, number, values, false)) return broken(c);
        i->n_sets++;
        return 0;
    }
    if (kind == END) i->stepping = false;
    if (kind == STEP) i->time = values[0].d;
    status = send_all(i, number, values);
    if (kind == STEP && status >= 0 && status <= WARNING) i->time = values[0].d + values[1].d;
    if (kind == BEGIN && status <= WARNING) i->stepping = i->cosimulation;
    if (kind != GET) i->after_step = kind == STEP && status >= 0 && status <= WARNING;
    return status;
}

static void forget(Instance *i) {
    Instance **place = &i->channel->instances;
    while (*place != NULL && *place != i) place = &(*place)->next;
    if (*place == i) *place = i->next;
    Buffer *all[] = {&i->sets, &i->reads, &i->answers, &i->texts, &i->operation, &i->early};
    for (size_t n = 0; n < sizeof all / sizeof *all; n++) free(all[n]->data);
    free(i->name);
    free(i);
}

static int release(void *handle, unsigned number) {
    Instance *i = handle;
    i->stepping = false;
    if (i->channel->end == ALIVE) send_all(i, number, NULL);
    i->made--;
    if (i->made == 0) forget(i);
    return 0;
}

/* ---- the functions of FMI ---------------------------------------------------------------------------------------- */

#define EXPORT_NOTHING(name, n)                                                                                        \
    EXPORT int name(void *h) { return TABLE[n].kind == FREE ? release(h, n) : forward(h, n, NULL); }
#define EXPORT_P(name, n)                                                                                              \
    EXPORT int name(void *h, void *a) { return forward(h, n, V{{.p = a}}); }
#define EXPORT_D(name, n)                                                                                              \
    EXPORT int name(void *h, double a) { return forward(h, n, V{{.d = a}}); }
#define EXPORT_PP(name, n)                                                                                             \
    EXPORT int name(void *h, void *a, void *b) { return forward(h, n, V{{.p = a}, {.p = b}}); }
#define EXPORT_IP(name, n)                                                                                             \
    EXPORT int name(void *h, int a, void *b) { return forward(h, n, V{{.i = a}, {.p = b}}); }
#define EXPORT_PZ(name, n)                                                                                             \
    EXPORT int name(void *h, void *a, size_t b) { return forward(h, n, V{{.p = a}, {.z = b}}); }
#define EXPORT_PPZ(name, n)                                                                                            \
    EXPORT int name(void *h, void *a, void *b, size_t c) { return forward(h, n, V{{.p = a}, {.p = b}, {.z = c}}); }
#define EXPORT_PZP(name, n)                                                                                            \
    EXPORT int name(void *h, void *a, size_t b, void *c) { return forward(h, n, V{{.p = a}, {.z = b}, {.p = c}}); }
#define EXPORT_IPP(name, n)                                                                                            \
    EXPORT int name(void *h, int a, void *b, void *c) { return forward(h, n, V{{.i = a}, {.p = b}, {.p = c}}); }
#define EXPORT_BPP(name, n)                                                                                            \
    EXPORT int name(void *h, bool a, void *b, void *c) { return forward(h, n, V{{.b = a}, {.p = b}, {.p = c}}); }
#define EXPORT_DDI(name, n)                                                                                            \
    EXPORT int name(void *h, double a, double b, int c) { return forward(h, n, V{{.d = a}, {.d = b}, {.i = c}}); }
#define EXPORT_PZPP(name, n)                                                                                           \
    EXPORT int name(void *h, void *a, size_t b, void *c, void *d) {                                                    \
        return forward(h, n, V{{.p = a}, {.z = b}, {.p = c}, {.p = d}});                                               \
    }
#define EXPORT_PZPZ(name, n)                                                                                           \
    EXPORT int name(void *h, void *a, size_t b, void *c, size_t d) {                                                   \
        return forward(h, n, V{{.p = a}, {.z = b}, {.p = c}, {.z = d}});                                               \
    }
#define EXPORT_PZPPP(name, n)                                                                                          \
    EXPORT int name(void *h, void *a, size_t b, void *c, void *d, void *e) {                                           \
        return forward(h, n, V{{.p = a}, {.z = b}, {.p = c}, {.p = d}, {.p = e}});                                     \
    }
#define EXPORT_PZPPZ(name, n)                                                                                          \
    EXPORT int name(void *h, void *a, size_t b, void *c, void *d, size_t e) {                                          \
        return forward(h, n, V{{.p = a}, {.z = b}, {.p = c}, {.p = d}, {.z = e}});                                     \
    }
#define EXPORT_IDDID(name, n)                                                                                          \
    EXPORT int name(void *h, int a, double b, double c, int d, double e) {                                             \
        return forward(h, n, V{{.i = a}, {.d = b}, {.d = c}, {.i = d}, {.d = e}});                                     \
    }
#define EXPORT_BDDBD(name, n)                                                                                          \
    EXPORT int name(void *h, bool a, double b, double c, bool d, double e) {                                           \
        return forward(h, n, V{{.b = a}, {.d = b}, {.d = c}, {.b = d}, {.d = e}});                                     \
    }
#define EXPORT_PZPZPP(name, n)                                                                                         \
    EXPORT int name(void *h, void *a, size_t b, void *c, size_t d, void *e, void *f) {                                 \
        return forward(h, n, V{{.p = a}, {.z = b}, {.p = c}, {.z = d}, {.p = e}, {.p = f}});                           \
    }
#define EXPORT_PPPPPP(name, n)                                                                                         \
    EXPORT int name(void *h, void *a, void *b, void *c, void *d, void *e, void *f) {                                   \
        return forward(h, n, V{{.p = a}, {.p = b}, {.p = c}, {.p = d}, {.p = e}, {.p = f}});                           \
    }
#define EXPORT_DDBPPPP(name, n)                                                                                        \
    EXPORT int name(void *h, double a, double b, bool c, void *d, void *e, void *f, void *g) {                         \
        return forward(h, n, V{{.d = a}, {.d = b}, {.b = c}, {.p = d}, {.p = e}, {.p = f}, {.p = g}});                 \
    }
#define EXPORT_PZPZPZPZ(name, n)                                                                                       \
    EXPORT int name(void *h, void *a, size_t b, void *c, size_t d, void *e, size_t f, void *g, size_t i) {             \
        return forward(h, n, V{{.p = a}, {.z = b}, {.p = c}, {.z = d}, {.p = e}, {.z = f}, {.p = g}, {.z = i}});       \
    }
#define EXPORT_INSTANTIATE(name, n)
#define FUNCTION(name, shape, ...) EXPORT_##shape(name, NUMBER_##name)
FUNCTIONS
#undef FUNCTION

/* Creates an instance in the process. Its request: type, logging, event mode, early return, then the texts name, GUID
   and resources; a resource location of NULL has no text. Its answer: the handle, 0 if the FMU refuses. */
static void *instantiate(Channel *c, unsigned number, const char *name, const char *guid, const char *resources,
                         const int options[4], void *logger, void *environment) {
    if (c->end != ALIVE) return NULL;
    Instance *i = calloc(1, sizeof *i);
    if (i == NULL || (i->name = strdup(name)) == NULL) return free(i), NULL;
    i->channel = c, i->number = ++c->numbers, i->fmi = number == NUMBER_fmi2Instantiate ? 2 : 3;
    i->cosimulation = number == NUMBER_fmi3InstantiateCoSimulation || (i->fmi == 2 && options[0] == 1);
    i->logger = logger, i->environment = environment, i->time = NAN;
    i->next = c->instances, c->instances = i;
    const char *texts[] = {name, guid, resources ? resources : ""};
    Operation head = {number, 0, 0, 0, i->number};
    bool well = append(&i->operation, &head, sizeof head);
    for (int n = 0; n < 4; n++) well = well && append_number(&i->operation, (uint64_t)(int64_t)options[n]);
    well = well && append_number(&i->operation, resources != NULL);
    for (int n = 0; n < 3; n++) well = well && append(&i->operation, texts[n], strlen(texts[n]) + 1);
    if (well) ((Operation *)i->operation.data)->size = i->operation.used;
    if (!well || !append(&c->request, i->operation.data, i->operation.used)) return broken(c), forget(i), NULL;
    if (!post(c, c->patience) || !await_reply(c, c->patience)) return forget(i), NULL;
    Answers all = answers_of(c);
    const Answer *answer = next_answer(&all);
    if (answer == NULL || answer->size < sizeof(Answer) + 8) return broken(c), forget(i), NULL;
    memcpy(&i->handle, answer + 1, 8);
    if (i->handle == 0) return forget(i), NULL;
    for (Instance *other = i->next; other != NULL; other = other->next) {
        if (other->handle != i->handle) continue;
        forget(i); /* an FMU that keeps everything in globals: the master compares handles */
        other->made++;
        return other;
    }
    i->made = 1;
    return i;
}

typedef struct {
    void *logger, *allocate, *release, *finished, *environment;
} Callbacks2;

EXPORT void *isolated_fmi2Instantiate(Channel *c, const char *name, int type, const char *guid, const char *resources,
                                      const Callbacks2 *callbacks, int visible, int logging) {
    (void)visible;
    int options[4] = {type, logging, 0, 0};
    return instantiate(c, NUMBER_fmi2Instantiate, name, guid, resources, options, callbacks->logger,
                       callbacks->environment);
}

EXPORT void *isolated_fmi3InstantiateCoSimulation(Channel *c, const char *name, const char *token,
                                                  const char *resources, bool visible, bool logging, bool events,
                                                  bool early, const uint32_t *required, size_t n, void *environment,
                                                  void *logger, void *update) {
    (void)visible, (void)required, (void)n, (void)update;
    int options[4] = {1, logging, events, early};
    return instantiate(c, NUMBER_fmi3InstantiateCoSimulation, name, token, resources, options, logger, environment);
}

EXPORT void *isolated_fmi3InstantiateModelExchange(Channel *c, const char *name, const char *token,
                                                   const char *resources, bool visible, bool logging, void *environment,
                                                   void *logger) {
    (void)visible;
    int options[4] = {0, logging, 0, 0};
    return instantiate(c, NUMBER_fmi3InstantiateModelExchange, name, token, resources, options, logger, environment);
}

/* ---- steps that are begun ahead of the calls that make them --------------------------------------------------------- */

EXPORT int isolated_begin_fmi2DoStep(void *h, double t, double step, int final) {
    return begin(h, NUMBER_fmi2DoStep, V{{.d = t}, {.d = step}, {.i = final}});
}

EXPORT int isolated_begin_fmi3DoStep(void *h, double t, double step, bool final, void *event, void *ends, void *early,
                                     void *last) {
    return begin(h, NUMBER_fmi3DoStep,
                 V{{.d = t}, {.d = step}, {.b = final}, {.p = event}, {.p = ends}, {.p = early}, {.p = last}});
}

/* Sends the steps that were begun in the process of an instance, once. The arguments are those of a step. */
EXPORT int isolated_post(void *handle, double t, double step, int final) {
    (void)t, (void)step, (void)final;
    Channel *c = ((Instance *)handle)->channel;
    if (c->end == ALIVE && !c->posted && c->begun.used) post(c, c->limit);
    return 0;
}

/* ---- what the master asks about a process ------------------------------------------------------------------------ */

#if SHARES
/* Waits until a process that was just started has loaded its FMU; returns NULL without memory for it.

   file: the shared memory; process: a pidfd of pid; output: a pipe with its output; limit, patience: see Channel. */
EXPORT Channel *isolated_open(int file, int process, int pid, int output, double limit, double patience) {
    Channel *c = calloc(1, sizeof *c);
    if (c == NULL) return NULL;
    c->file = file, c->process = process, c->pid = pid, c->output = output, c->limit = limit, c->patience = patience;
    c->socket = c->master = -1;
    read_without_waiting(output);
    size_t size = (size_t)lseek(file, 0, SEEK_END);
    c->memory = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (c->memory == MAP_FAILED) return free(c), NULL;
    c->mapped = size;
    wait_for_turn(c, patience);
    if (c->end == ALIVE && header(c)->version != VERSION) end_by(c, BROKEN);
    return c;
}
#endif

/* Opens a channel to a process on another machine, which isolated_relay serves there; returns NULL without memory.

   file: memory of this process, where SHARES; socket: blocking, with time limits for silence (SO_RCVTIMEO, SO_SNDTIMEO). */
EXPORT Channel *isolated_connect(int file, int socket, double limit, double patience) {
    Channel *c = calloc(1, sizeof *c);
    if (c == NULL) return NULL;
    c->file = file, c->process = c->output = c->master = -1, c->socket = socket;
    c->limit = limit, c->patience = patience;
#if SHARES
    c->mapped = (size_t)lseek(file, 0, SEEK_END);
    c->memory = mmap(NULL, c->mapped, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (c->memory == MAP_FAILED) return free(c), NULL;
#else
    c->mapped = 2 * MESSAGES;
    c->memory = calloc(1, c->mapped);
    if (c->memory == NULL) return free(c), NULL;
#endif
    receive_state(c);
    return c;
}

/* Says that the process at the other end of the socket is portable.c, with a pipe of its output. */
EXPORT void isolated_direct(Channel *c, int output) {
    c->direct = true, c->output = output;
    read_without_waiting(output);
}

/* Replaces a process on another machine that has ended by a new one; returns whether that has loaded the FMU. */
EXPORT bool isolated_reconnect(Channel *c, int socket) {
    c->socket = socket, c->end = ALIVE, c->n_lines = 0;
    return receive_state(c);
}

#if SHARES
/* Serves a master on another machine until the connection or the process ends; returns the end of the process. */
EXPORT int isolated_relay(Channel *c, int socket) {
    c->master = socket;
    relay(c);
    c->master = -1;
    return c->end;
}
#endif

EXPORT void isolated_close(Channel *c) {
    while (c->instances != NULL) forget(c->instances);
#if SHARES
    munmap(c->memory, c->mapped);
#else
    free(c->memory);
#endif
    Buffer *all[] = {&c->request, &c->begun, &c->start, &c->since, &c->made, &c->states};
    for (size_t n = 0; n < sizeof all / sizeof *all; n++) free(all[n]->data);
    free_kept(&c->kept);
    free(c);
}

/* Lets a process be started anew after a crash, before it has any instance.

   most: how often; every: the number of requests between two states kept; start_anew: starts a process, passes it to
   isolated_reopen, and returns what that returns. */
EXPORT void isolated_restart_by(Channel *c, int most, unsigned every, bool (*start_anew)(void)) {
    c->most_restarts = most, c->every = every, c->start_anew = start_anew;
}

#if SHARES
/* Replaces a process that has ended by a new one, as isolated_open; returns whether that has loaded the FMU. */
EXPORT bool isolated_reopen(Channel *c, int file, int process, int pid, int output) {
    size_t size = (size_t)lseek(file, 0, SEEK_END);
    void *memory = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (memory == MAP_FAILED) return false;
    munmap(c->memory, c->mapped);
    c->memory = memory, c->mapped = size, c->end = ALIVE, c->n_lines = 0;
    c->file = file, c->process = process, c->pid = pid, c->output = output;
    read_without_waiting(output);
    if (!wait_for_turn(c, c->patience)) return false;
    if (header(c)->version == VERSION && !header(c)->failed) return true;
    end_by(c, BROKEN);
    return false;
}
#endif

/* Forbids to start the process anew. */
EXPORT void isolated_give_up(Channel *c) { c->given_up = true; }

/* Returns whether the process is not started anew any more because states of its instances could not be kept. */
EXPORT bool isolated_unkept(Channel *c) { return c->unkept; }

/* Returns the simulation time of the instance whose call was the last one; NAN if it has not made a step. */
EXPORT double isolated_time(Channel *c) {
    Instance *i = numbered(c, c->end_owner);
    return i == NULL ? NAN : i->time;
}

/* Tells the process to end, after its instances have been freed. */
EXPORT void isolated_quit(Channel *c) {
    Header *h = header(c);
    if (c->end != ALIVE) return;
    if (c->socket >= 0) {
        hang_up(c->socket);
        return;
    }
    h->quit = 1, h->request = 0;
    wake(c);
}

EXPORT const char *isolated_refusal(Channel *c) { return header(c)->failed ? header(c)->text : NULL; }
EXPORT uint32_t isolated_restrictions(Channel *c) { return header(c)->restricted; }

EXPORT bool isolated_has(Channel *c, const char *name) {
    for (unsigned n = 0; n < N_FUNCTIONS; n++)
        if (!strcmp(TABLE[n].name, name)) return header(c)->has[n] != 0;
    return false;
}

/* Returns the cause of the end of the process (End), with its details. */
EXPORT int isolated_end(Channel *c, int *number, const char **function, const char **owner, uint64_t *memory) {
    *number = c->end_number, *memory = c->end_memory, *owner = NULL;
    *function = c->end_function ? TABLE[c->end_function - 1].name : NULL;
    for (Instance *i = c->instances; i != NULL; i = i->next)
        if (i->number == c->end_owner) *owner = i->name;
    return c->end;
}

/* Returns the deferred call of an instance that has failed, and its status; NULL if none has. It is returned once. */
EXPORT const char *isolated_failed_set(Instance *i, int *status) {
    int function = i->set_failed;
    *status = i->set_status, i->set_failed = 0;
    return function ? TABLE[function - 1].name : NULL;
}

/* Copies the last output of the process to `text`, at most `room` bytes; returns their number. */
EXPORT size_t isolated_output(Channel *c, char *text, size_t room) {
    read_output(c);
    size_t n = c->n_lines < room ? c->n_lines : room;
    memcpy(text, c->lines + c->n_lines - n, n);
    return n;
}
