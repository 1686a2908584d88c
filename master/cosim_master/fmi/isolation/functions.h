/* The FMI functions that cross the boundary of a process: their C types, and the contents of their messages.

   FUNCTION(name, shape, kind, arguments after the instance ...)

   The shape names the types of these arguments, one letter each: P pointer, Z size_t, D double, I int, B bool.
   An argument of a message is one of

     INT, BOOL, SIZE, DOUBLE  a value
     HANDLE                   a pointer that has a meaning only in the process of the FMU (a saved state)
     IN(size, n)              an array of elements of `size` bytes; their number is the value of argument n
     OUT(size, n)             the same, filled by the FMU
     PLACE(size)              one value that the FMU may replace
     TEXTS_IN(n), TEXTS_OUT(n)    arrays of texts
     BYTES_IN(n), BYTES_OUT(n)    arrays of Binaries, whose sizes are the argument before

   Arguments are counted from 0, without the instance.

   Kinds: SET may be deferred until the next step; GET may be answered from the reply to a step; STEP makes a step;
   CALL is sent at once; BEGIN and END are calls after which Step Mode begins or ends; FREE has no status. */

#define GETS_AND_SETS2(type, size)                                                                                     \
    FUNCTION(fmi2Set##type, PZP, SET, IN(4, 1), SIZE, IN(size, 1))                                                     \
    FUNCTION(fmi2Get##type, PZP, GET, IN(4, 1), SIZE, OUT(size, 1))

#define GETS_AND_SETS3(type, size)                                                                                     \
    FUNCTION(fmi3Set##type, PZPZ, SET, IN(4, 1), SIZE, IN(size, 3), SIZE)                                              \
    FUNCTION(fmi3Get##type, PZPZ, GET, IN(4, 1), SIZE, OUT(size, 3), SIZE)

#define FUNCTIONS                                                                                                      \
    GETS_AND_SETS2(Real, 8)                                                                                            \
    GETS_AND_SETS2(Integer, 4)                                                                                         \
    GETS_AND_SETS2(Boolean, 4)                                                                                         \
    FUNCTION(fmi2SetString, PZP, SET, IN(4, 1), SIZE, TEXTS_IN(1))                                                     \
    FUNCTION(fmi2GetString, PZP, GET, IN(4, 1), SIZE, TEXTS_OUT(1))                                                    \
    FUNCTION(fmi2SetRealInputDerivatives, PZPP, SET, IN(4, 1), SIZE, IN(4, 1), IN(8, 1))                               \
    FUNCTION(fmi2DoStep, DDI, STEP, DOUBLE, DOUBLE, INT)                                                               \
    FUNCTION(fmi2CancelStep, NOTHING, END)                                                                             \
    FUNCTION(fmi2SetupExperiment, IDDID, CALL, INT, DOUBLE, DOUBLE, INT, DOUBLE)                                       \
    FUNCTION(fmi2EnterInitializationMode, NOTHING, CALL)                                                               \
    FUNCTION(fmi2ExitInitializationMode, NOTHING, BEGIN)                                                               \
    FUNCTION(fmi2Terminate, NOTHING, END)                                                                              \
    FUNCTION(fmi2FreeInstance, NOTHING, FREE)                                                                          \
    FUNCTION(fmi2GetRealStatus, IP, CALL, INT, PLACE(8))                                                               \
    FUNCTION(fmi2GetBooleanStatus, IP, CALL, INT, PLACE(4))                                                            \
    FUNCTION(fmi2GetMaxStepSize, P, CALL, PLACE(8))                                                                    \
    FUNCTION(fmi2GetFMUstate, P, CALL, PLACE(8))                                                                       \
    FUNCTION(fmi2SetFMUstate, P, CALL, HANDLE)                                                                         \
    FUNCTION(fmi2FreeFMUstate, P, CALL, PLACE(8))                                                                      \
    FUNCTION(fmi2SerializedFMUstateSize, PP, CALL, HANDLE, PLACE(8))                                                   \
    FUNCTION(fmi2SerializeFMUstate, PPZ, CALL, HANDLE, OUT(1, 2), SIZE)                                                \
    FUNCTION(fmi2DeSerializeFMUstate, PZP, CALL, IN(1, 1), SIZE, PLACE(8))                                             \
    FUNCTION(fmi2GetDirectionalDerivative, PZPZPP, CALL, IN(4, 1), SIZE, IN(4, 3), SIZE, IN(8, 3), OUT(8, 1))          \
    FUNCTION(fmi2SetTime, D, SET, DOUBLE)                                                                              \
    FUNCTION(fmi2SetContinuousStates, PZ, SET, IN(8, 1), SIZE)                                                         \
    FUNCTION(fmi2GetDerivatives, PZ, CALL, OUT(8, 1), SIZE)                                                            \
    FUNCTION(fmi2GetEventIndicators, PZ, CALL, OUT(8, 1), SIZE)                                                        \
    FUNCTION(fmi2GetContinuousStates, PZ, CALL, OUT(8, 1), SIZE)                                                       \
    FUNCTION(fmi2GetNominalsOfContinuousStates, PZ, CALL, OUT(8, 1), SIZE)                                             \
    FUNCTION(fmi2EnterEventMode, NOTHING, CALL)                                                                        \
    FUNCTION(fmi2EnterContinuousTimeMode, NOTHING, CALL)                                                               \
    FUNCTION(fmi2NewDiscreteStates, P, CALL, PLACE(32))                                                                \
    FUNCTION(fmi2CompletedIntegratorStep, IPP, CALL, INT, PLACE(4), PLACE(4))                                          \
    GETS_AND_SETS3(Float32, 4)                                                                                         \
    GETS_AND_SETS3(Float64, 8)                                                                                         \
    GETS_AND_SETS3(Int8, 1)                                                                                            \
    GETS_AND_SETS3(UInt8, 1)                                                                                           \
    GETS_AND_SETS3(Int16, 2)                                                                                           \
    GETS_AND_SETS3(UInt16, 2)                                                                                          \
    GETS_AND_SETS3(Int32, 4)                                                                                           \
    GETS_AND_SETS3(UInt32, 4)                                                                                          \
    GETS_AND_SETS3(Int64, 8)                                                                                           \
    GETS_AND_SETS3(UInt64, 8)                                                                                          \
    GETS_AND_SETS3(Boolean, 1)                                                                                         \
    FUNCTION(fmi3SetString, PZPZ, SET, IN(4, 1), SIZE, TEXTS_IN(3), SIZE)                                              \
    FUNCTION(fmi3GetString, PZPZ, GET, IN(4, 1), SIZE, TEXTS_OUT(3), SIZE)                                             \
    FUNCTION(fmi3SetBinary, PZPPZ, SET, IN(4, 1), SIZE, IN(8, 4), BYTES_IN(4), SIZE)                                   \
    FUNCTION(fmi3GetBinary, PZPPZ, GET, IN(4, 1), SIZE, OUT(8, 4), BYTES_OUT(4), SIZE)                                 \
    FUNCTION(fmi3SetClock, PZP, CALL, IN(4, 1), SIZE, IN(1, 1))                                                        \
    FUNCTION(fmi3GetClock, PZP, CALL, IN(4, 1), SIZE, OUT(1, 1))                                                       \
    FUNCTION(fmi3GetIntervalDecimal, PZPP, CALL, IN(4, 1), SIZE, PLACE(8), PLACE(4))                                   \
    FUNCTION(fmi3GetIntervalFraction, PZPPP, CALL, IN(4, 1), SIZE, PLACE(8), PLACE(8), PLACE(4))                       \
    FUNCTION(fmi3GetShiftDecimal, PZP, CALL, IN(4, 1), SIZE, PLACE(8))                                                 \
    FUNCTION(fmi3GetShiftFraction, PZPP, CALL, IN(4, 1), SIZE, PLACE(8), PLACE(8))                                     \
    FUNCTION(fmi3SetIntervalDecimal, PZP, CALL, IN(4, 1), SIZE, IN(8, 1))                                              \
    FUNCTION(fmi3SetIntervalFraction, PZPP, CALL, IN(4, 1), SIZE, IN(8, 1), IN(8, 1))                                  \
    FUNCTION(fmi3DoStep, DDBPPPP, STEP, DOUBLE, DOUBLE, BOOL, PLACE(1), PLACE(1), PLACE(1), PLACE(8))                  \
    FUNCTION(fmi3EnterInitializationMode, BDDBD, CALL, BOOL, DOUBLE, DOUBLE, BOOL, DOUBLE)                             \
    FUNCTION(fmi3ExitInitializationMode, NOTHING, BEGIN)                                                               \
    FUNCTION(fmi3EnterConfigurationMode, NOTHING, END)                                                                 \
    FUNCTION(fmi3ExitConfigurationMode, NOTHING, CALL)                                                                 \
    FUNCTION(fmi3EnterEventMode, NOTHING, END)                                                                         \
    FUNCTION(fmi3EnterStepMode, NOTHING, BEGIN)                                                                        \
    FUNCTION(fmi3UpdateDiscreteStates, PPPPPP, CALL, PLACE(1), PLACE(1), PLACE(1), PLACE(1), PLACE(1), PLACE(8))       \
    FUNCTION(fmi3Terminate, NOTHING, END)                                                                              \
    FUNCTION(fmi3FreeInstance, NOTHING, FREE)                                                                          \
    FUNCTION(fmi3GetFMUState, P, CALL, PLACE(8))                                                                       \
    FUNCTION(fmi3SetFMUState, P, CALL, HANDLE)                                                                         \
    FUNCTION(fmi3FreeFMUState, P, CALL, PLACE(8))                                                                      \
    FUNCTION(fmi3SerializedFMUStateSize, PP, CALL, HANDLE, PLACE(8))                                                   \
    FUNCTION(fmi3SerializeFMUState, PPZ, CALL, HANDLE, OUT(1, 2), SIZE)                                                \
    FUNCTION(fmi3DeserializeFMUState, PZP, CALL, IN(1, 1), SIZE, PLACE(8))                                             \
    FUNCTION(fmi3GetDirectionalDerivative, PZPZPZPZ, CALL, IN(4, 1), SIZE, IN(4, 3), SIZE, IN(8, 5), SIZE, OUT(8, 7),  \
             SIZE)                                                                                                     \
    FUNCTION(fmi3SetTime, D, SET, DOUBLE)                                                                              \
    FUNCTION(fmi3SetContinuousStates, PZ, SET, IN(8, 1), SIZE)                                                         \
    FUNCTION(fmi3GetContinuousStateDerivatives, PZ, CALL, OUT(8, 1), SIZE)                                             \
    FUNCTION(fmi3GetEventIndicators, PZ, CALL, OUT(8, 1), SIZE)                                                        \
    FUNCTION(fmi3GetContinuousStates, PZ, CALL, OUT(8, 1), SIZE)                                                       \
    FUNCTION(fmi3GetNominalsOfContinuousStates, PZ, CALL, OUT(8, 1), SIZE)                                             \
    FUNCTION(fmi3GetNumberOfContinuousStates, P, CALL, PLACE(8))                                                       \
    FUNCTION(fmi3GetNumberOfEventIndicators, P, CALL, PLACE(8))                                                        \
    FUNCTION(fmi3EnterContinuousTimeMode, NOTHING, CALL)                                                               \
    FUNCTION(fmi3CompletedIntegratorStep, BPP, CALL, BOOL, PLACE(1), PLACE(1))                                         \
    FUNCTION(fmi2Instantiate, INSTANTIATE, MAKE)                                                                       \
    FUNCTION(fmi3InstantiateCoSimulation, INSTANTIATE, MAKE)                                                           \
    FUNCTION(fmi3InstantiateModelExchange, INSTANTIATE, MAKE)

/* SHAPE(name, parameters, arguments), for every shape above. */
#define SHAPES                                                                                                         \
    SHAPE(NOTHING, (void *h), (h))                                                                                     \
    SHAPE(P, (void *h, void *a), (h, a.p))                                                                             \
    SHAPE(D, (void *h, double a), (h, a.d))                                                                            \
    SHAPE(PP, (void *h, void *a, void *b), (h, a.p, b.p))                                                              \
    SHAPE(IP, (void *h, int a, void *b), (h, a.i, b.p))                                                                \
    SHAPE(PZ, (void *h, void *a, size_t b), (h, a.p, b.z))                                                             \
    SHAPE(PPZ, (void *h, void *a, void *b, size_t c), (h, a.p, b.p, c.z))                                              \
    SHAPE(PZP, (void *h, void *a, size_t b, void *c), (h, a.p, b.z, c.p))                                              \
    SHAPE(IPP, (void *h, int a, void *b, void *c), (h, a.i, b.p, c.p))                                                 \
    SHAPE(BPP, (void *h, bool a, void *b, void *c), (h, a.b, b.p, c.p))                                                \
    SHAPE(DDI, (void *h, double a, double b, int c), (h, a.d, b.d, c.i))                                               \
    SHAPE(PZPP, (void *h, void *a, size_t b, void *c, void *d), (h, a.p, b.z, c.p, d.p))                               \
    SHAPE(PZPZ, (void *h, void *a, size_t b, void *c, size_t d), (h, a.p, b.z, c.p, d.z))                              \
    SHAPE(PZPPP, (void *h, void *a, size_t b, void *c, void *d, void *e), (h, a.p, b.z, c.p, d.p, e.p))                \
    SHAPE(PZPPZ, (void *h, void *a, size_t b, void *c, void *d, size_t e), (h, a.p, b.z, c.p, d.p, e.z))               \
    SHAPE(IDDID, (void *h, int a, double b, double c, int d, double e), (h, a.i, b.d, c.d, d.i, e.d))                  \
    SHAPE(BDDBD, (void *h, bool a, double b, double c, bool d, double e), (h, a.b, b.d, c.d, d.b, e.d))                \
    SHAPE(PZPZPP, (void *h, void *a, size_t b, void *c, size_t d, void *e, void *f), (h, a.p, b.z, c.p, d.z, e.p, f.p)) \
    SHAPE(PPPPPP, (void *h, void *a, void *b, void *c, void *d, void *e, void *f),                                     \
          (h, a.p, b.p, c.p, d.p, e.p, f.p))                                                                           \
    SHAPE(DDBPPPP, (void *h, double a, double b, bool c, void *d, void *e, void *f, void *g),                          \
          (h, a.d, b.d, c.b, d.p, e.p, f.p, g.p))                                                                      \
    SHAPE(PZPZPZPZ, (void *h, void *a, size_t b, void *c, size_t d, void *e, size_t f, void *g, size_t i),             \
          (h, a.p, b.z, c.p, d.z, e.p, f.z, g.p, i.z))
