# How the house adds things. Second-level folders are libraries `<top>_<folder>` with the alias
# `mesorig::<top>_<folder>`; registry folders (drivers, codecs, exchange) hold one library a
# subfolder, and their registry table is generated from the calls below.

# Optimising costs more than it gains in tests, and under sanitizers in all that computes little: CI
# has two cores. Pixels, rays and factors stay optimised. Targets of one speed share their flags,
# and so their precompiled headers (MesorigPrecompiled.cmake).
function(mesorig_optimise name kind)
  if(kind STREQUAL "test")
    set(speed test)
  elseif(kind STREQUAL "program" OR name MATCHES "^client_")
    set(speed program)
  elseif(name MATCHES "^(protocol|daemon)_")
    set(speed plain)
  else()
    set(speed pixels)
  endif()
  target_compile_options(${name} PRIVATE ${MESORIG_SPEED_${speed}})
  if(MESORIG_PRECOMPILE AND NOT name STREQUAL "protocol_messages")
    target_precompile_headers(${name} REUSE_FROM mesorig_precompiled_${speed})
    # GCC 12's are false in std::string, and it forgets there that a precompiled header is a system's.
    target_compile_options(${name} PRIVATE -Wno-array-bounds -Wno-restrict -Wno-stringop-overflow
                           -Wno-stringop-overread)
  endif()
endfunction()

# mesorig_add_library(processing_btf SOURCES a.cc b.cc LINK mesorig::protocol_base ...)
function(mesorig_add_library name)
  cmake_parse_arguments(arg "" "" "SOURCES;LINK" ${ARGN})
  add_library(${name} STATIC ${arg_SOURCES})
  add_library(mesorig::${name} ALIAS ${name})
  target_include_directories(${name} PUBLIC ${CMAKE_SOURCE_DIR} ${CMAKE_BINARY_DIR}/generated)
  target_link_libraries(${name} PUBLIC ${arg_LINK})
  mesorig_optimise(${name} library)
  set_property(GLOBAL APPEND PROPERTY MESORIG_LIBRARIES ${name})
endfunction()

# mesorig_add_program(mesorigd SOURCES main.cc LINK ...)
function(mesorig_add_program name)
  cmake_parse_arguments(arg "" "" "SOURCES;LINK" ${ARGN})
  add_executable(${name} ${arg_SOURCES})
  target_include_directories(${name} PRIVATE ${CMAKE_SOURCE_DIR} ${CMAKE_BINARY_DIR}/generated)
  target_link_libraries(${name} PRIVATE ${arg_LINK})
  mesorig_optimise(${name} program)
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/bin)
  # What the demo needs: ninja programs.
  if(NOT TARGET programs)
    add_custom_target(programs)
  endif()
  add_dependencies(programs ${name})
endfunction()

# mesorig_add_test(protocol_rig_test SOURCES rig_test.cc LINK mesorig::protocol_rig [DEPENDS mesorigd])
# One GoogleTest binary, registered as one ctest test. MESORIG_BIN_DIR and MESORIG_SOURCE_DIR name
# the programs and the source tree; DEPENDS names the programs that it starts.
function(mesorig_add_test name)
  cmake_parse_arguments(arg "" "TIMEOUT" "SOURCES;LINK;DEPENDS;LABELS" ${ARGN})
  add_executable(${name} ${arg_SOURCES})
  target_include_directories(${name} PRIVATE ${CMAKE_SOURCE_DIR} ${CMAKE_BINARY_DIR}/generated)
  # (fmt: what the precompiled headers were compiled with.)
  target_link_libraries(${name} PRIVATE ${arg_LINK} fmt::fmt GTest::gmock GTest::gtest_main)
  target_compile_definitions(${name} PRIVATE MESORIG_SOURCE_DIR="${CMAKE_SOURCE_DIR}"
                             MESORIG_BIN_DIR="${CMAKE_BINARY_DIR}/bin")
  mesorig_optimise(${name} test)
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/tests)
  add_test(NAME ${name} COMMAND ${name})
  if(NOT arg_TIMEOUT)
    set(arg_TIMEOUT 300)
  endif()
  if(MESORIG_SANITIZE STREQUAL "thread")
    math(EXPR arg_TIMEOUT "${arg_TIMEOUT} * 4")
  endif()
  if(NOT arg_LABELS)
    set(arg_LABELS unit)
  endif()
  set_tests_properties(${name} PROPERTIES TIMEOUT ${arg_TIMEOUT} LABELS "${arg_LABELS}")
  if(arg_DEPENDS)
    add_dependencies(${name} ${arg_DEPENDS})
  endif()
  # What the sanitizer build needs: ninja unit_tests.
  if("unit" IN_LIST arg_LABELS)
    if(NOT TARGET unit_tests)
      add_custom_target(unit_tests)
    endif()
    add_dependencies(unit_tests ${name})
  endif()
endfunction()

# mesorig_add_fuzzer(rig_file SOURCES rig_file.cc LINK mesorig::protocol_rig): a libFuzzer binary
# fuzzers/rig_file of the preset fuzz; ninja fuzzers builds them all. tests/fuzz/README.md.
function(mesorig_add_fuzzer name)
  cmake_parse_arguments(arg "" "" "SOURCES;LINK" ${ARGN})
  add_executable(fuzz_${name} ${arg_SOURCES})
  target_include_directories(fuzz_${name} PRIVATE ${CMAKE_SOURCE_DIR} ${CMAKE_BINARY_DIR}/generated)
  target_compile_definitions(fuzz_${name} PRIVATE MESORIG_SOURCE_DIR="${CMAKE_SOURCE_DIR}")
  target_link_libraries(fuzz_${name} PRIVATE ${arg_LINK})
  target_link_options(fuzz_${name} PRIVATE -fsanitize=fuzzer)
  set_target_properties(fuzz_${name} PROPERTIES OUTPUT_NAME ${name}
                        RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/fuzzers)
  if(NOT TARGET fuzzers)
    add_custom_target(fuzzers)
  endif()
  add_dependencies(fuzzers fuzz_${name})
endfunction()

# Registries. mesorig_registry_entry(codecs view_svd "view-svd") is called by mesorig_add_codec and
# its like; mesorig_write_registry(codecs ...) at the end of the registry folder writes
# generated/processing/codecs/registry_table.inc with one line MESORIG_ENTRY(id, "name") an entry.
function(mesorig_registry_entry registry id public_name)
  set_property(GLOBAL APPEND PROPERTY MESORIG_REGISTRY_${registry} "MESORIG_ENTRY(${id}, \"${public_name}\")")
endfunction()
function(mesorig_write_registry registry path)
  get_property(lines GLOBAL PROPERTY MESORIG_REGISTRY_${registry})
  list(JOIN lines "\n" text)
  file(CONFIGURE OUTPUT ${CMAKE_BINARY_DIR}/generated/${path}/registry_table.inc
       CONTENT "// Generated by CMake from the registry calls of this folder.\n${text}\n" @ONLY)
endfunction()

# mesorig_add_driver(cia402 NAME "cia402" SOURCES ... LINK ...): daemon/drivers/README.md.
function(mesorig_add_driver id)
  cmake_parse_arguments(arg "" "NAME" "SOURCES;LINK" ${ARGN})
  mesorig_add_library(daemon_drivers_${id} SOURCES ${arg_SOURCES}
    LINK mesorig::daemon_device mesorig::daemon_bus ${arg_LINK})
  mesorig_registry_entry(drivers ${id} ${arg_NAME})
  set_property(GLOBAL APPEND PROPERTY MESORIG_DRIVERS mesorig::daemon_drivers_${id})
endfunction()

# Writes target_graph.txt, one line a library, `name what it links`, for the test that holds the
# graph against the design (tests/end_to_end/architecture_test.cc).
function(mesorig_write_graph)
  get_property(libraries GLOBAL PROPERTY MESORIG_LIBRARIES)
  set(text "")
  foreach(library ${libraries})
    get_target_property(links ${library} LINK_LIBRARIES)
    list(JOIN links " " links)
    string(APPEND text "${library} ${links}\n")
  endforeach()
  file(WRITE ${CMAKE_BINARY_DIR}/target_graph.txt "${text}")
endfunction()

# mesorig_add_codec(view_svd "view-svd" DECODE view_svd.cc ENCODE encode.cc [GLSL decode.glsl] [LINK ...])
# Targets codecs_decode_<id> and codecs_encode_<id>; codecs_decode and codecs_encode link them all.
# The sources define mesorig::codecs::<id>::TheDecoder() and TheEncoder(). GLSL becomes
# generated/processing/codecs/<id>/decode_glsl.inc, a raw string literal. LINK is for the encoder.
function(mesorig_add_codec id public_name)
  cmake_parse_arguments(arg "" "GLSL" "DECODE;ENCODE;LINK" ${ARGN})
  if(arg_GLSL)
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${arg_GLSL})
    file(READ ${arg_GLSL} glsl)
    file(CONFIGURE OUTPUT ${CMAKE_BINARY_DIR}/generated/processing/codecs/${id}/decode_glsl.inc
         CONTENT "R\"glsl(@glsl@)glsl\"\n" @ONLY)
  endif()
  mesorig_add_library(codecs_decode_${id} SOURCES ${arg_DECODE} LINK mesorig::codecs_decode_core)
  mesorig_add_library(codecs_encode_${id} SOURCES ${arg_ENCODE}
    LINK codecs_decode_${id} mesorig::codecs_encode_core)
  target_link_libraries(codecs_encode_${id} PRIVATE nlohmann_json::nlohmann_json ${arg_LINK})
  set_property(GLOBAL APPEND PROPERTY MESORIG_CODEC_IDS ${id})
  mesorig_registry_entry(codecs ${id} "${public_name}")
endfunction()

# mesorig_add_importer(multi_light "multi-light" SOURCES multi_light.cc [LINK ...])
# Target processing_exchange_<id>; the sources define mesorig::exchange::<id>::TheImporter().
function(mesorig_add_importer id public_name)
  cmake_parse_arguments(arg "" "" "SOURCES;LINK" ${ARGN})
  mesorig_add_library(processing_exchange_${id} SOURCES ${arg_SOURCES} LINK mesorig::processing_btf)
  target_link_libraries(processing_exchange_${id} PRIVATE ${arg_LINK})
  set_property(GLOBAL APPEND PROPERTY MESORIG_IMPORTER_IDS ${id})
  mesorig_registry_entry(exchange ${id} "${public_name}")
endfunction()
