# Clients: modalctl, the C library, Python; and where everything is installed.
file(GLOB client_sources CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/clients/c/*.c)
add_library(modald_client STATIC ${client_sources})
target_include_directories(modald_client PUBLIC ${CMAKE_SOURCE_DIR}/clients/c)
target_link_libraries(modald_client PUBLIC house wire store PkgConfig::ZMQ)

file(GLOB ctl_sources CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/clients/ctl/*.c)
list(FILTER ctl_sources EXCLUDE REGEX "/main\\.c$")
add_library(ctl STATIC ${ctl_sources})                 # a library, so that the unit tests reach it
target_include_directories(ctl PUBLIC ${CMAKE_SOURCE_DIR}/clients)
target_link_libraries(ctl PUBLIC house modald_client job store wire PkgConfig::SNDFILE)
program(modalctl clients/ctl/main.c ctl)
