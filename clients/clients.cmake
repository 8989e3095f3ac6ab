# Clients: the C libraries, modalctl, Python; and where everything is installed.
set(C ${CMAKE_SOURCE_DIR}/clients/c)

# The client library: in this tree static on top of the rooms; installed, one shared object that shows modald.h only.
set(client_sources ${C}/link.c ${C}/client.c ${C}/modald.c)
add_library(modald_client STATIC ${client_sources})
target_include_directories(modald_client PUBLIC ${C})
target_link_libraries(modald_client PUBLIC house wire store PkgConfig::ZMQ)

add_library(modald_client_shared SHARED ${client_sources})
target_link_libraries(modald_client_shared PRIVATE house wire store PkgConfig::ZMQ)
target_link_options(modald_client_shared PRIVATE -Wl,--version-script=${C}/modald.map -Wl,--gc-sections -Wl,--as-needed)
set_target_properties(modald_client_shared PROPERTIES OUTPUT_NAME modald-client VERSION ${PROJECT_VERSION} SOVERSION 0 LINK_DEPENDS ${C}/modald.map)

# The streaming client: one .c, made of its parts, one .h, libzmq.  What is linked here is what hosts may copy.
set(stream_source ${CMAKE_BINARY_DIR}/clients/c/modald_stream.c)
file(GLOB stream_parts CONFIGURE_DEPENDS ${C}/stream/*)
add_custom_command(OUTPUT ${stream_source} COMMAND ${C}/stream/amalgamate > ${stream_source}
  DEPENDS ${stream_parts} ${CMAKE_SOURCE_DIR}/src/base/crc32c.c ${CMAKE_SOURCE_DIR}/src/base/crc32c.h VERBATIM)
add_custom_target(stream_source DEPENDS ${stream_source})
file(MAKE_DIRECTORY ${CMAKE_BINARY_DIR}/clients/c)
foreach(kind STATIC SHARED)
  string(TOLOWER modald_stream_${kind} target)
  add_library(${target} ${kind} ${stream_source})
  add_dependencies(${target} stream_source)           # made once, though two are made of it
  target_include_directories(${target} PUBLIC ${C} ${CMAKE_BINARY_DIR}/clients/c)
  target_link_libraries(${target} PRIVATE house PUBLIC PkgConfig::ZMQ Threads::Threads m)
  set_target_properties(${target} PROPERTIES OUTPUT_NAME modald-stream VERSION ${PROJECT_VERSION} SOVERSION 0)
endforeach()
target_link_options(modald_stream_shared PRIVATE -Wl,-z,nodelete)       # a thread may still be in it when a host takes its plug-in out

# modalctl: a library, so that the unit tests reach it, and its main.
file(GLOB_RECURSE ctl_sources CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/clients/ctl/*.c)
list(FILTER ctl_sources EXCLUDE REGEX "/main\\.c$")
add_library(ctl STATIC ${ctl_sources})
target_include_directories(ctl PUBLIC ${CMAKE_SOURCE_DIR}/clients)
target_link_libraries(ctl PUBLIC house modald_client modald_stream_static job store wire PkgConfig::SNDFILE PkgConfig::ZLIB)
program(modalctl clients/ctl/main.c ctl)

# The manuals of scenes and results are what modalctl says of them.
foreach(about scene result)
  set(page ${CMAKE_BINARY_DIR}/modald-${about}.5)
  add_custom_command(OUTPUT ${page} COMMAND ${CMAKE_SOURCE_DIR}/clients/ctl/manual_page $<TARGET_FILE:modalctl> ${about} > ${page}
    DEPENDS modalctl ${CMAKE_SOURCE_DIR}/clients/ctl/manual_page VERBATIM)
  list(APPEND manual_pages ${page})
endforeach()
add_custom_target(manual ALL DEPENDS ${manual_pages})

# Examples: time-stepping loops with the three calls.  Those whose other half is not installed are left out.
add_executable(example_loop ${CMAKE_SOURCE_DIR}/clients/c/examples/loop.c)
target_link_libraries(example_loop PRIVATE house modald_stream_static m)
add_executable(example_identify ${CMAKE_SOURCE_DIR}/clients/c/examples/identify.c)
target_include_directories(example_identify PRIVATE ${C})
target_link_libraries(example_identify PRIVATE house modald_client_shared)
set(examples example_loop example_identify)
add_executable(rosco_bridge ${CMAKE_SOURCE_DIR}/clients/c/examples/rosco_bridge.c)
target_link_libraries(rosco_bridge PRIVATE house modald_stream_static)
add_executable(mbdyn_listener ${CMAKE_SOURCE_DIR}/clients/c/examples/mbdyn_listener.c)
target_link_libraries(mbdyn_listener PRIVATE house modald_stream_static)
list(APPEND examples rosco_bridge mbdyn_listener)
include(CheckLanguage)
check_language(Fortran)
if(CMAKE_Fortran_COMPILER)
  enable_language(Fortran)
  add_library(modald_fortran STATIC ${C}/modald.f90)
  set_target_properties(modald_fortran PROPERTIES OUTPUT_NAME modald-fortran Fortran_MODULE_DIRECTORY ${CMAKE_BINARY_DIR}/fortran)
  target_include_directories(modald_fortran PUBLIC ${CMAKE_BINARY_DIR}/fortran)
  target_link_libraries(modald_fortran PUBLIC modald_stream_static)
  add_executable(example_loop_fortran ${CMAKE_SOURCE_DIR}/clients/c/examples/loop.f90)
  target_link_libraries(example_loop_fortran PRIVATE modald_fortran)
  list(APPEND examples example_loop_fortran)
endif()
include(CheckLanguage)
check_language(CXX)
find_package(Simbody QUIET)
if(CMAKE_CXX_COMPILER AND Simbody_FOUND)
  enable_language(CXX)
  add_executable(example_ziegler ${CMAKE_SOURCE_DIR}/clients/c/examples/ziegler.cpp)
  set_target_properties(example_ziegler PROPERTIES CXX_STANDARD 17)
  target_include_directories(example_ziegler SYSTEM PRIVATE ${Simbody_INCLUDE_DIR})
  target_link_libraries(example_ziegler PRIVATE modald_stream_static ${Simbody_LIBRARIES})
  list(APPEND examples example_ziegler)
endif()
set_target_properties(${examples} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/examples)

include(${CMAKE_CURRENT_LIST_DIR}/install.cmake)
