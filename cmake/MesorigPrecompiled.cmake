# Precompiled headers: half of the time of a compilation here is the parsing of abseil, fmt, the
# standard library and GoogleTest. They are precompiled once for each set of flags (the speeds of
# mesorig_optimise) and reused by every target with these flags. No source relies on it: each
# includes what it uses, and clang's presets build without.
if(CMAKE_CXX_COMPILER_ID STREQUAL GNU)
  option(MESORIG_PRECOMPILE "precompiled headers" ON)
endif()
if(NOT MESORIG_PRECOMPILE)
  return()
endif()
add_compile_options(-pthread)          # some packages ask for it; all flags must be the same
add_compile_options(-fpch-preprocess)  # ccache needs it

set(MESORIG_PRECOMPILED_HEADERS
  <absl/status/status.h> <absl/status/statusor.h> <fmt/core.h>
  <algorithm> <array> <atomic> <chrono> <cmath> <condition_variable> <cstdint> <cstring>
  <filesystem> <fstream> <functional> <map> <memory> <mutex> <optional> <set> <span> <sstream>
  <string> <string_view> <thread> <tuple> <utility> <variant> <vector>)

# mesorig_precompiled(SPEED HEADERS ... LINK ...): the headers above and these.
function(mesorig_precompiled speed)
  cmake_parse_arguments(arg "" "" "HEADERS;LINK" ${ARGN})
  set(name mesorig_precompiled_${speed})
  file(CONFIGURE OUTPUT ${CMAKE_BINARY_DIR}/generated/precompiled.cc CONTENT "")
  add_library(${name} OBJECT EXCLUDE_FROM_ALL ${CMAKE_BINARY_DIR}/generated/precompiled.cc)
  target_link_libraries(${name} PRIVATE absl::status absl::statusor fmt::fmt ${arg_LINK})
  target_compile_options(${name} PRIVATE ${MESORIG_SPEED_${speed}})
  target_precompile_headers(${name} PRIVATE ${MESORIG_PRECOMPILED_HEADERS} ${arg_HEADERS})
endfunction()

mesorig_precompiled(pixels)
mesorig_precompiled(program HEADERS <CLI/CLI.hpp> <nlohmann/json.hpp>
                    LINK CLI11::CLI11 nlohmann_json::nlohmann_json)
if(MESORIG_SANITIZE)
  mesorig_precompiled(plain)
else()
  add_library(mesorig_precompiled_plain ALIAS mesorig_precompiled_pixels)  # the same flags
endif()
if(MESORIG_TESTS)
  mesorig_precompiled(test HEADERS <gmock/gmock.h> <gtest/gtest.h> LINK GTest::gmock GTest::gtest)
endif()
