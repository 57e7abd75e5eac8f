# Compiler flags that every target of the project gets.
set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_CXX_FLAGS_RELEASE "-O2")  # assertions of MESORIG_CHECK stay in; NDEBUG would drop assert()

set(MESORIG_SANITIZE "" CACHE STRING "sanitizers, e.g. address,undefined or thread")
set(MESORIG_ARCH "x86-64-v3" CACHE STRING "-march: binaries must also run on another machine")

add_compile_options(-march=${MESORIG_ARCH} -Wall -Wextra -Wshadow -Wconversion -Wno-sign-conversion)
option(MESORIG_TESTS "build the tests" ON)
option(MESORIG_WERROR "warnings are errors" ON)
if(MESORIG_WERROR)
  add_compile_options(-Werror)
endif()
if(CMAKE_CXX_COMPILER_ID MATCHES Clang)
  add_compile_options(-Wthread-safety)
endif()
option(MESORIG_FUZZ "the fuzzers of tests/fuzz instead of the tests (clang)" OFF)
# Flags beside the build type's, for the speeds of mesorig_optimise.
set(MESORIG_SPEED_test -O1)
if(MESORIG_SANITIZE)
  foreach(speed test program plain)
    set(MESORIG_SPEED_${speed} -O0)
  endforeach()
  if(MESORIG_FUZZ)
    add_compile_options(-fsanitize=fuzzer-no-link)
  endif()
  add_compile_options(-fsanitize=${MESORIG_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=all -g1)
  add_link_options(-fsanitize=${MESORIG_SANITIZE})
  # A third of the build's time, for what AddressSanitizer finds too.
  add_compile_options(-fno-sanitize=null,alignment,vptr,object-size)
  if(CMAKE_CXX_COMPILER_ID STREQUAL GNU)
    add_compile_options(-Wno-maybe-uninitialized)  # GCC's are false under sanitizers (std::regex)
  endif()
endif()

# Same paths in every checkout, so that ccache hits across clones (of one parent folder). Its depend
# mode spares a preprocessor run a compilation; the sloppiness is what precompiled headers ask for.
add_compile_options(-ffile-prefix-map=${CMAKE_SOURCE_DIR}=.)
if(CMAKE_CXX_COMPILER_LAUNCHER STREQUAL ccache)
  cmake_path(GET CMAKE_SOURCE_DIR PARENT_PATH parent_dir)
  set(CMAKE_CXX_COMPILER_LAUNCHER env CCACHE_BASEDIR=${parent_dir} CCACHE_NOHASHDIR=1
      CCACHE_DEPEND=1 CCACHE_SLOPPINESS=pch_defines,time_macros ccache)
endif()
