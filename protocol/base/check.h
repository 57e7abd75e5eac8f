#pragma once
// MESORIG_CHECK(condition) is for our own bugs only; what input or hardware can break is a Status.

#include <cstdio>
#include <cstdlib>

#define MESORIG_CHECK(condition)                                                            \
  do {                                                                                      \
    if (!(condition)) {                                                                     \
      std::fprintf(stderr, "%s:%d: check failed: %s\n", __FILE__, __LINE__, #condition);    \
      std::abort();                                                                         \
    }                                                                                       \
  } while (false)
