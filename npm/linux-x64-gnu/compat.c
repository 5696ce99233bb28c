// What Debian 13's Embree and TBB take from newer C and C++ libraries than Debian 12 has. Without headers, whose strtol may be
// the function defined here.
extern long strtol(const char *, char **, int);
extern void *__cxa_begin_catch(void *);
// std::terminate()
extern void _ZSt9terminatev(void) __attribute__((noreturn));
// std::ios_base::Init::Init()
extern void _ZNSt8ios_base4InitC1Ev(void *);

long __isoc23_strtol(const char *text, char **end, int base) { return strtol(text, end, base); }

void __cxa_call_terminate(void *exception) {
    if (exception) __cxa_begin_catch(exception);
    _ZSt9terminatev();
}

// std::ios_base_library_init()
void _ZSt21ios_base_library_initv(void) {
    static char init[16];
    _ZNSt8ios_base4InitC1Ev(init);
}
