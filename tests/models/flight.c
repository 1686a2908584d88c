/* A model's kernels as functions of its record, and a loop that steps two models as `Copter.tick` and
 * `Pair.one_step` do, until a time or until the packets of the steps need more room. */
#include <math.h>
#include <stdint.h>
#include <string.h>

int model_start(int *code, void **exception, void *record);
int model_advance(int *code, void **exception, void *record, double t, double h);

int start(void *record)
{
    int code = 0;
    void *exception = 0;
    return model_start(&code, &exception, record) ? -1 : code;
}

int advance(void *record, double t, double h)
{
    int code = 0;
    void *exception = 0;
    return model_advance(&code, &exception, record, t, h) ? -1 : code;
}

typedef struct {
    unsigned char *to;
    const unsigned char *of;
    int64_t size;
} Span;

typedef struct {
    int32_t *given;             /* length of what it hears in a step */
    const int32_t *got;         /* length of what it says */
    const unsigned char *text;  /* what it says */
} Line;

typedef struct {
    int64_t step, line, length;
} Packets; /* followed by their bytes, filled up to eight */

typedef struct {
    int (*pilot)(void *, double, double);
    int (*vehicle)(void *, double, double);
    void *pilots, *vehicles; /* records */
    double h, inner;         /* step sizes */
    int64_t direct;          /* the motors obey in the step in which they are commanded */
    Span motors;             /* from the pilot's commands to the vehicle */
    int64_t spans, lines;
    const Span *span;
    const Line *line;
    double *position, *velocity, *attitude; /* as the pilot knows them */
    const double *errors;                   /* rows of nine, or none */
    int64_t rows_of_errors, row, advances;  /* which one is next, and whether the one after it follows */
    const double *columns[3];               /* of three numbers each, for the table */
    double *table;                          /* rows of time and columns, or none */
    unsigned char *log;
    int64_t room, used;
} Flight;

/* Returns whether the pilot senses its motion with the errors: not if it stands vertically. */
static int err(const Flight *f)
{
    int64_t last = f->rows_of_errors - 1, row = f->row < 0 ? 0 : f->row > last ? last : f->row;
    const double *e = f->errors + 9 * row;
    double *q = f->attitude;
    double sine = 2.0 * (q[0] * q[2] - q[3] * q[1]);
    if (fabs(sine) > 0.999)
        return 0;
    for (int i = 0; i < 3; i++) {
        f->position[i] += e[i];
        f->velocity[i] += e[3 + i];
    }
    double roll = atan2(2.0 * (q[0] * q[1] + q[2] * q[3]), 1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2])) + e[6];
    double pitch = asin(sine) + e[7];
    double yaw = atan2(2.0 * (q[0] * q[3] + q[1] * q[2]), 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3])) + e[8];
    double cr = cos(0.5 * roll), sr = sin(0.5 * roll), cp = cos(0.5 * pitch), sp = sin(0.5 * pitch);
    double cy = cos(0.5 * yaw), sy = sin(0.5 * yaw);
    q[0] = cr * cp * cy + sr * sp * sy;
    q[1] = sr * cp * cy - cr * sp * sy;
    q[2] = cr * sp * cy + sr * cp * sy;
    q[3] = cr * cp * sy - sr * sp * cy;
    return 1;
}

/* Makes up to `count` steps from `step` on; returns how many. There are fewer if there might be no room for packets or
 * if the pilot stands vertically; then `failed` is 0. */
int64_t fly(Flight *f, int64_t step, int64_t count, int *failed)
{
    unsigned char before[256];
    int64_t inner = llround(f->h / f->inner), made;
    *failed = 0;
    f->used = 0;
    for (made = 0; made < count && f->used < f->room; made++) {
        double t = (double)(step + made) * f->h;
        for (int64_t i = 0; i < f->spans; i++)
            memcpy(f->span[i].to, f->span[i].of, f->span[i].size);
        if (f->errors && !err(f))
            break;
        f->row += f->advances;
        memcpy(before, f->motors.of, f->motors.size);
        for (int64_t i = 0; i < f->lines; i++)
            *f->line[i].given = 0;
        if ((*failed = f->pilot(f->pilots, t, f->h)))
            break;
        memcpy(f->motors.to, f->direct ? f->motors.of : before, f->motors.size);
        for (int64_t k = 0; k < inner; k++)
            if ((*failed = f->vehicle(f->vehicles, t + (double)k * f->inner, f->inner)))
                return made;
        for (int64_t i = 0; i < f->lines; i++)
            if (*f->line[i].got) {
                Packets head = {step + made, i, *f->line[i].got};
                memcpy(f->log + f->used, &head, sizeof head);
                memcpy(f->log + f->used + sizeof head, f->line[i].text, head.length);
                f->used += sizeof head + (head.length + 7) / 8 * 8;
            }
        if (f->table) {
            double *row = f->table + 10 * made;
            row[0] = (double)(step + made + 1) * f->h;
            for (int i = 0; i < 9; i++)
                row[1 + i] = f->columns[i / 3][i % 3];
        }
    }
    return made;
}
