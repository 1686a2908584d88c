/* Starts the process of an FMU file anew after a crash, and brings its instances back to where they were.

   The master's side keeps all requests: those up to the first state kept for ever (instantiation, initialization), those
   since the last state until the next one is kept. A new process gets the former, then the states, then the latter, and
   must answer as the old one did.

   Addresses in the process (handles of instances, states of FMI) differ after that. Operations name instances by their
   number; for states, the master gets numbers, too: 1 + the place in `states`, the first free one. Both are translated
   in shared memory, so that requests can be kept as they are. Part of proxy.c. */

#ifndef RESTART_H
#define RESTART_H

#define MOST_KEPT (4u << 20) /* bytes of requests after which states are kept early */

/* What the FMU has made: an instance, by its number - 1. */
typedef struct {
    uint64_t handle;
    uint64_t state;     /* in which its present state is kept again and again */
    uint64_t unsettled; /* a call has failed: its state is not worth to be kept */
} Made;

/* A state of the FMU that the master holds; 0: none. */
typedef struct {
    uint64_t address, owner;
} State;

/* A serialised state: of an instance (place 0), or one that the master holds. */
typedef struct {
    uint64_t owner, place;
    char *content;
    size_t size;
} Kept;

/* A request that the process has executed; its operations follow. */
typedef struct {
    uint64_t size, answers; /* bytes; digest of the answers */
} Executed;

static Made *made_of(Channel *c, uint64_t owner) {
    size_t n = c->made.used / sizeof(Made);
    return owner && owner <= n ? (Made *)c->made.data + owner - 1 : NULL;
}

static State *state_at(Channel *c, uint64_t place) {
    size_t n = c->states.used / sizeof(State);
    return place && place <= n ? (State *)c->states.data + place - 1 : NULL;
}

static Instance *numbered(Channel *c, uint64_t owner) {
    Instance *i = c->instances;
    while (i != NULL && i->number != owner) i = i->next;
    return i;
}

typedef enum { NO_STATE, GETS, SETS, RELEASES, READS } Use;

static Use use_of(unsigned function) {
    switch (function) {
    case NUMBER_fmi2GetFMUstate:
    case NUMBER_fmi3GetFMUState:
    case NUMBER_fmi2DeSerializeFMUstate:
    case NUMBER_fmi3DeserializeFMUState: return GETS;
    case NUMBER_fmi2SetFMUstate:
    case NUMBER_fmi3SetFMUState: return SETS;
    case NUMBER_fmi2FreeFMUstate:
    case NUMBER_fmi3FreeFMUState: return RELEASES;
    case NUMBER_fmi2SerializedFMUstateSize:
    case NUMBER_fmi3SerializedFMUStateSize:
    case NUMBER_fmi2SerializeFMUstate:
    case NUMBER_fmi3SerializeFMUState: return READS;
    default: return NO_STATE;
    }
}

/* Returns the place of the state in an operation; NULL if it has none. */
static uint64_t *state_in(Operation *o) {
    uint64_t *words = (uint64_t *)(o + 1);
    Use use = use_of(o->function);
    if (use == NO_STATE) return NULL;
    if (use == SETS || use == READS) return words;
    if (TABLE[o->function].arguments[0].type == A_PLACE) return words + 1;
    return (uint64_t *)((char *)(words + 3) + padded(words[1])); /* after the bytes of a serialised state */
}

/* Replaces the numbers of instances and states in a request by their addresses in the process. */
static void translate(Channel *c, char *data, size_t bytes) {
    for (size_t at = 0; at < bytes; at += ((Operation *)(data + at))->size) {
        Operation *o = (Operation *)(data + at);
        Made *made = made_of(c, o->owner);
        if (made != NULL) o->handle = made->handle;
        uint64_t *place = state_in(o);
        if (place == NULL) continue;
        State *state = state_at(c, *place);
        *place = state == NULL ? 0 : state->address;
    }
}

static uint64_t digest(uint64_t so_far, const void *data, size_t bytes) {
    const uint64_t *words = data; /* FNV-1a, by words: answers are padded to them */
    for (size_t n = 0; n < bytes / 8; n++) so_far = (so_far ^ words[n]) * 1099511628211u, so_far ^= so_far >> 32;
    return so_far;
}

/* Returns the number of a state that the FMU has made at `address`; `before` is the number given to it. 0: no memory. */
static uint64_t number_of_state(Channel *c, uint64_t owner, uint64_t before, uint64_t address) {
    State *given = state_at(c, before);
    uint64_t n = c->states.used / sizeof(State), free_place = before;
    if (given == NULL)
        for (free_place = 1; free_place <= n && state_at(c, free_place)->address; free_place++) {}
    State state = {address, owner};
    if (free_place > n) return append(&c->states, &state, sizeof state) ? free_place : 0;
    *state_at(c, free_place) = state;
    return free_place;
}

/* Takes note of the answers to a request, and replaces addresses in them by numbers; returns their digest. */
static uint64_t take_note(Channel *c, char *request, size_t bytes) {
    Answers all = answers_of(c);
    uint64_t sum = 14695981039346656037u;
    uint32_t number = 0;
    const Answer *answer = next_answer(&all);
    for (size_t at = 0; at < bytes && answer != NULL; number++) {
        Operation *o = (Operation *)(request + at);
        at += o->size;
        if (answer->operation != number) continue;
        bool well = answer->status >= 0 && answer->status <= WARNING;
        Made *made = made_of(c, o->owner);
        Use use = use_of(o->function);
        uint64_t head[2] = {(uint64_t)(uint32_t)answer->status, number}, *given = (uint64_t *)(answer + 1);
        sum = digest(sum, head, sizeof head);
        if (TABLE[o->function].kind == MAKE) {
            Made new = {*given, 0, 0};
            Instance *i = numbered(c, o->owner);
            if (made != NULL) *made = new;
            else append(&c->made, &new, sizeof new);
            if (i != NULL) i->handle = *given;
        } else if (use == GETS || use == RELEASES) {
            uint64_t before = *state_in(o);
            State *state = state_at(c, before);
            if (use == RELEASES && well && state != NULL) state->address = 0;
            if (use == GETS && well) *given = number_of_state(c, o->owner, before, *given);
            else *given = well ? 0 : before;
        } else {
            sum = digest(sum, answer + 1, answer->size - sizeof(Answer));
        }
        if (made != NULL && !well) made->unsettled = 1;
        else if (made != NULL && (TABLE[o->function].kind == STEP || use == SETS)) made->unsettled = 0;
        answer = next_answer(&all);
    }
    return sum;
}

/* Keeps a request that was executed. */
static void keep_request(Channel *c) {
    Executed head = {c->request.used, take_note(c, c->request.data, c->request.used)};
    Buffer *into = c->keeps ? &c->since : &c->start;
    if (!append(into, &head, sizeof head) || !append(into, c->request.data, c->request.used)) c->most_restarts = 0;
    c->n_since++;
}

/* ---- states -------------------------------------------------------------------------------------------------------- */

/* Makes operations of this file's own, with real addresses; returns whether the process has answered. */
static bool ask(Channel *c, const Buffer *operations, bool translated) {
    if (!hand_over(c, operations, translated, c->patience)) return false;
    bool well = wait_for_turn(c, c->patience);
    if (well && !map(c, 0)) end_by(c, BROKEN), well = false;
    header(c)->log = 0; /* the FMU has said it before, or will */
    if (!well) header(c)->executed = 0;
    return well;
}

static unsigned of_version(const Instance *i, unsigned in2, unsigned in3) { return i->fmi == 2 ? in2 : in3; }
#define STATE_FUNCTION(i, verb2, verb3) of_version(i, NUMBER_fmi2##verb2, NUMBER_fmi3##verb3)

/* Makes one operation; returns its status, -1 if there is no answer. */
static int ask_one(Instance *i, unsigned number, const Value *values) {
    Buffer one = {0};
    int status = -1;
    if (write_operation(&one, i, number, values, false) && ask(i->channel, &one, false)) {
        Answers all = answers_of(i->channel);
        const Answer *answer = next_answer(&all);
        if (answer != NULL && read_answer(i, number, values, (const char *)answer, answer->size))
            status = answer->status;
    }
    free(one.data);
    return status;
}

static bool passed(int status) { return status >= 0 && status <= WARNING; }

/* Serialises a state of an instance; returns whether that has worked. */
static bool serialise(Instance *i, uint64_t place, uint64_t address, Buffer *into) {
    Kept one = {i->number, place, NULL, 0};
    Value state = {.bits = address};
    if (!passed(ask_one(i, STATE_FUNCTION(i, SerializedFMUstateSize, SerializedFMUStateSize), V{state, {.p = &one.size}})))
        return false;
    one.content = malloc(one.size + 1);
    if (one.content == NULL) return false;
    unsigned number = STATE_FUNCTION(i, SerializeFMUstate, SerializeFMUState);
    if (passed(ask_one(i, number, V{state, {.p = one.content}, {.z = one.size}})) && append(into, &one, sizeof one))
        return true;
    free(one.content);
    return false;
}

static void free_kept(Buffer *kept) {
    for (size_t at = 0; at < kept->used; at += sizeof(Kept)) free(((Kept *)(kept->data + at))->content);
    free(kept->data);
    *kept = (Buffer){0};
}

/* Returns whether it is time to keep states: all instances are between two steps, and enough was sent since. */
static bool keeping_is_due(Channel *c) {
    if (c->keeps && c->n_since < c->every && c->since.used < MOST_KEPT) return false;
    if (c->instances == NULL) return false;
    for (Instance *i = c->instances; i != NULL; i = i->next) {
        Made *made = made_of(c, i->number);
        if (!i->stepping || made == NULL || made->unsettled) return false;
    }
    return true;
}

/* Keeps the states of all instances, and those that the master holds. */
static bool keep_states(Channel *c) {
    Buffer kept = {0};
    bool well = true;
    for (Instance *i = c->instances; i != NULL && well; i = i->next) {
        uint64_t *place = &made_of(c, i->number)->state;
        well = passed(ask_one(i, STATE_FUNCTION(i, GetFMUstate, GetFMUState), V{{.p = place}})) &&
               serialise(i, 0, *place, &kept);
    }
    for (uint64_t place = 1; place <= c->states.used / sizeof(State) && well; place++) {
        State *state = state_at(c, place);
        Instance *owner = numbered(c, state->owner);
        if (state->address && owner != NULL) well = serialise(owner, place, state->address, &kept);
    }
    if (!well) return free_kept(&kept), false;
    free_kept(&c->kept);
    c->kept = kept, c->keeps = true;
    c->since.used = 0, c->n_since = 0;
    return true;
}

/* ---- a new process ----------------------------------------------------------------------------------------------------- */

static bool replay(Channel *c, const Buffer *requests) {
    for (size_t at = 0; at < requests->used;) {
        const Executed *head = (const Executed *)(requests->data + at);
        Buffer one = {requests->data + at + sizeof *head, head->size, head->size};
        at += sizeof *head + head->size;
        if (!ask(c, &one, true)) return false;
        if (take_note(c, one.data, one.used) != head->answers) return end_by(c, DIFFERENT), false;
    }
    return true;
}

/* Brings a new process to where the old one was before its last request. */
static bool bring_back(Channel *c) {
    c->states.used = 0;
    if (!replay(c, &c->start)) return false;
    if (!c->keeps) return true;
    c->states.used = 0;
    for (size_t at = 0; at < c->kept.used; at += sizeof(Kept)) {
        Kept *one = (Kept *)(c->kept.data + at);
        Instance *i = numbered(c, one->owner);
        State none = {0, 0};
        uint64_t address = 0;
        if (i == NULL) continue;
        unsigned number = STATE_FUNCTION(i, DeSerializeFMUstate, DeserializeFMUState);
        if (!passed(ask_one(i, number, V{{.p = one->content}, {.z = one->size}, {.p = &address}}))) return false;
        if (one->place) {
            while (c->states.used / sizeof(State) < one->place)
                if (!append(&c->states, &none, sizeof none)) return false;
            *state_at(c, one->place) = (State){address, one->owner};
            continue;
        }
        if (!passed(ask_one(i, STATE_FUNCTION(i, SetFMUstate, SetFMUState), V{{.bits = address}}))) return false;
        made_of(c, one->owner)->state = address, made_of(c, one->owner)->unsettled = 0;
    }
    return replay(c, &c->since);
}

static bool crashed(const Channel *c) { return c->end == SIGNALLED || c->end == EXITED; }

/* Starts a crashed process anew, as often as it may be; returns whether it is where the old one was. */
static bool recover(Channel *c) {
    while (crashed(c) && c->restarts < c->most_restarts && !c->given_up) {
        c->restarts++;
        if (!c->start_anew()) return false;
        if (bring_back(c)) return true;
        if (c->end == ALIVE) end_by(c, DIFFERENT);
    }
    return false;
}

/* Starts a process that has crashed in a request anew, and makes the request again; returns whether it has a reply. */
static bool again(Channel *c, double limit) {
    while (recover(c)) {
        if (!hand_over(c, &c->request, true, limit)) return false;
        bool well = wait_for_turn(c, limit);
        if (well && !map(c, 0)) end_by(c, BROKEN), well = false;
        pass_log_on(c);
        if (well) return true;
    }
    return false;
}

/* Keeps states before a request, if it is time. A process that crashes meanwhile is started anew; if its states cannot
   be kept, it is not started anew any more. */
static bool keep_if_due(Channel *c) {
    if (!keeping_is_due(c) || keep_states(c)) return true;
    c->n_since = 0;
    if (c->end != ALIVE) return recover(c);
    c->unkept = true, c->given_up = true;
    return true;
}

#endif
