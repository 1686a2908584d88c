/* Carries the messages of a channel over TCP to another machine, where the process of the FMU is.

   On the master's machine, the memory of the channel is its own: a request is written to it as ever, and then sent; the
   reply is received to where the process would have written it. On the other machine, isolated_relay hands each request
   over to the process in shared memory, and sends its reply, or how the process has ended. While the process is busy, it
   sends a pulse every second, so that silence means a lost connection. Part of proxy.c. */

#ifndef REMOTE_H
#define REMOTE_H

#define PULSE 1000000000 /* ns */

/* ---- on the master's machine ------------------------------------------------------------------------------------- */

static bool lost(Channel *c) {
    if (c->end == ALIVE) c->end = LOST, c->end_number = errno;
    return false;
}

static bool send_request(Channel *c, size_t bytes, double limit) {
    Posted head = {bytes, limit};
    struct iovec parts[] = {{&head, sizeof head}, {c->memory + MESSAGES, bytes}};
    return transmit(c->socket, parts, 2) || lost(c);
}

static bool receive_reply(Channel *c) {
    Replied r = {.pulse = 1};
    while (r.pulse)
        if (!receive(c->socket, &r, sizeof r)) return lost(c);
    if (r.end > BROKEN || r.function > N_FUNCTIONS || r.log > LOG_BYTES || r.reply > LARGEST || r.output > OUTPUT_BYTES ||
        !map(c, reply_at(header(c)) + r.reply))
        return end_by(c, BROKEN), false;
    if (!receive(c->socket, c->memory + HEADER_BYTES, r.log)) return lost(c);
    if (!receive(c->socket, c->memory + reply_at(header(c)), r.reply)) return lost(c);
    if (r.output && !receive(c->socket, c->lines, r.output)) return lost(c);
    header(c)->log = r.log, header(c)->executed = r.executed;
    if (r.end == ALIVE) return true;
    c->end = r.end, c->end_number = r.number, c->end_function = r.function;
    c->end_owner = r.owner, c->end_memory = r.memory;
    if (!c->direct) c->n_lines = r.output;
    return false;
}

/* Waits until the process has sent something or has ended; false if it does neither within `limit` s (0: any time). */
static bool readable(Channel *c, double limit) {
    for (int64_t began = now(), passed = 0; limit <= 0 || (double)passed < limit * 1e9; passed = now() - began) {
        if (has_message(c->socket, 50)) return true;
        read_output(c); /* a full pipe would stop it */
    }
    return false;
}

/* Receives the state of a process that was just started; false if there is none. */
static bool receive_state(Channel *c) {
    Replied r;
    Header theirs;
    if (!receive(c->socket, &r, sizeof r)) return lost(c);
    if (r.end != ALIVE || r.reply != sizeof theirs || r.log || r.output) return end_by(c, BROKEN), false;
    if (!receive(c->socket, &theirs, sizeof theirs)) return lost(c);
    theirs.size = c->mapped, theirs.request = theirs.log = theirs.executed = 0;
    memcpy(c->memory, &theirs, sizeof theirs);
    if (theirs.version == VERSION && !theirs.failed) return true;
    return end_by(c, BROKEN), false;
}

/* ---- on the machine of the process ------------------------------------------------------------------------------- */

#if SHARES

static bool tell(Channel *c, const void *reply, size_t bytes) {
    Header *h = header(c);
    bool over = c->end != ALIVE;
    Replied r = {c->end, c->end_number, c->end_function, h->executed, c->end_owner, c->end_memory,
                 h->log <= LOG_BYTES ? h->log : 0, bytes, over ? c->n_lines : 0, 0};
    struct iovec parts[] = {
        {&r, sizeof r}, {c->memory + HEADER_BYTES, r.log}, {(void *)reply, bytes}, {c->lines, r.output}};
    return transmit(c->master, parts, 4);
}

/* Tells the master that the process is busy; false if the master has gone: it sends nothing while it waits. */
static bool pulse(Channel *c) {
    if (has_message(c->master, 0)) return false;
    int64_t at = now();
    if (at - c->pulsed < PULSE) return true;
    c->pulsed = at;
    Replied r = {.pulse = 1};
    struct iovec part = {&r, sizeof r};
    return transmit(c->master, &part, 1);
}

static void relay(Channel *c) {
    Posted head;
    if (!tell(c, header(c), sizeof(Header))) return;
    while (c->end == ALIVE && receive(c->master, &head, sizeof head)) {
        c->request.used = 0;
        if (head.bytes > LARGEST / 2 || !reserve(&c->request, head.bytes)) return;
        if (!receive(c->master, c->request.data, head.bytes)) return;
        c->request.used = head.bytes, c->pulsed = now();
        if (hand_over(c, &c->request, false, head.limit) && wait_for_turn(c, head.limit) && !map(c, 0)) end_by(c, BROKEN);
        Answers all = answers_of(c);
        size_t begin = all.at;
        while (next_answer(&all) != NULL) {}
        if (!tell(c, c->memory + begin, all.at - begin)) return;
        header(c)->log = 0;
    }
}

#endif

#endif
