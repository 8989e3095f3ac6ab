# Where Debian expects things (GNUInstallDirs): sbin, bin, lib/ARCH, include, share/man, lib/systemd, lib/sysusers.d, lib/tmpfiles.d.
if(CMAKE_INSTALL_PREFIX STREQUAL "/usr")
  set(etc /etc)
  set(python lib/python3/dist-packages)
else()
  set(etc ${CMAKE_INSTALL_SYSCONFDIR})
  set(python lib/python3.11/dist-packages)
endif()
# libmodal, the numerics alone, is static: its functions are those of the house, and change with it.
install(TARGETS modal modald_stream_static modald_stream_shared modald_client_shared
  LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
install(DIRECTORY ${CMAKE_SOURCE_DIR}/src/modal/ DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/modal FILES_MATCHING PATTERN "*.h")
install(DIRECTORY ${CMAKE_SOURCE_DIR}/src/base DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/modal FILES_MATCHING PATTERN "*.h")
install(FILES ${C}/modald.h ${C}/modald_stream.h DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
install(FILES ${CMAKE_BINARY_DIR}/modald-monitor.fmu DESTINATION ${CMAKE_INSTALL_DATADIR}/modald)
install(FILES ${stream_source} DESTINATION ${CMAKE_INSTALL_DATADIR}/modald)     # for hosts that link no library
# Bridges are programs; the other examples are sources to begin from.
install(PROGRAMS $<TARGET_FILE:rosco_bridge> DESTINATION ${CMAKE_INSTALL_BINDIR} RENAME modald-rosco-bridge)
install(PROGRAMS $<TARGET_FILE:mbdyn_listener> DESTINATION ${CMAKE_INSTALL_BINDIR} RENAME modald-mbdyn-listener)
install(DIRECTORY ${C}/examples DESTINATION ${CMAKE_INSTALL_DOCDIR} PATTERN "*.1" EXCLUDE)
install(DIRECTORY ${CMAKE_SOURCE_DIR}/clients/python/examples/ DESTINATION ${CMAKE_INSTALL_DOCDIR}/examples/python
  FILES_MATCHING PATTERN "*.py")
if(TARGET modald_fortran)
  install(TARGETS modald_fortran ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
  install(FILES ${CMAKE_BINARY_DIR}/fortran/modald.mod DESTINATION ${CMAKE_INSTALL_LIBDIR}/fortran/modald)
  install(FILES ${C}/modald.f90 DESTINATION ${CMAKE_INSTALL_DATADIR}/modald)
endif()

# pkg-config: NAME, what it is, its libraries, what of ours it needs; what a static link needs too, by name: pkg-config asks for the
# .pc of others even where their libraries are not linked.  The prefix follows the file, wherever it is installed.
file(RELATIVE_PATH up /${CMAKE_INSTALL_LIBDIR}/pkgconfig /)
function(pkg_config NAME DESCRIPTION LIBS REQUIRES LIBS_PRIVATE)
  file(WRITE ${CMAKE_BINARY_DIR}/pkgconfig/${NAME}.pc
"prefix=\${pcfiledir}/${up}
libdir=\${prefix}/${CMAKE_INSTALL_LIBDIR}
includedir=\${prefix}/${CMAKE_INSTALL_INCLUDEDIR}

Name: ${NAME}
Description: ${DESCRIPTION}
Version: ${PROJECT_VERSION}
Requires: ${REQUIRES}
Cflags: -I\${includedir} ${ARGN}
Libs: -L\${libdir} ${LIBS}
Libs.private: ${LIBS_PRIVATE}
")
  install(FILES ${CMAKE_BINARY_DIR}/pkgconfig/${NAME}.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
endfunction()
# A static library alone, so each of its libraries is named: the .pc of others need not be there.
pkg_config(modal "frequencies, damping, stability and steady vibration: the numerics"
           "-lmodal -lcjson -lcrypto -llapacke -lopenblas -lfftw3 -llua5.4 -lumfpack -lm -lpthread" "" "" "-I\${includedir}/modal")
pkg_config(modald-stream "samples of a running simulation to modald" "-lmodald-stream" "" "-lzmq -lm -lpthread")
if(TARGET modald_fortran)
  pkg_config(modald-fortran "samples of a running simulation in Fortran to modald" "-lmodald-fortran" "modald-stream" "-lm -lpthread" "-I\${libdir}/fortran/modald")
endif()
pkg_config(modald-client "jobs on modald from C" "-lmodald-client" "" "-lzmq -lcjson -lm -lpthread")

# Service files, man pages, completion, Python.
set(S ${CMAKE_SOURCE_DIR}/systemd)
file(READ ${S}/modald.service unit)
string(REPLACE "/usr/sbin/modald" "${CMAKE_INSTALL_FULL_SBINDIR}/modald" unit "${unit}")
string(REPLACE "/etc/modald" "${CMAKE_INSTALL_FULL_SYSCONFDIR}/modald" unit "${unit}")
file(WRITE ${CMAKE_BINARY_DIR}/systemd/modald.service "${unit}")
install(FILES ${CMAKE_BINARY_DIR}/systemd/modald.service DESTINATION lib/systemd/system)
file(READ ${S}/modald-slurm@.service unit)
string(REPLACE "/usr/bin/modald-slurm" "${CMAKE_INSTALL_FULL_BINDIR}/modald-slurm" unit "${unit}")
string(REPLACE "/etc/modald" "${CMAKE_INSTALL_FULL_SYSCONFDIR}/modald" unit "${unit}")
file(WRITE ${CMAKE_BINARY_DIR}/systemd/modald-slurm@.service "${unit}")
install(FILES ${CMAKE_BINARY_DIR}/systemd/modald-slurm@.service DESTINATION lib/systemd/system)
install(PROGRAMS ${CMAKE_SOURCE_DIR}/clients/slurm/modald-slurm DESTINATION ${CMAKE_INSTALL_BINDIR})
if(TARGET modald-web)
  file(READ ${S}/modald-web.service unit)
  string(REPLACE "/usr/sbin/modald-web" "${CMAKE_INSTALL_FULL_SBINDIR}/modald-web" unit "${unit}")
  string(REPLACE "/etc/default" "${CMAKE_INSTALL_FULL_SYSCONFDIR}/default" unit "${unit}")
  file(WRITE ${CMAKE_BINARY_DIR}/systemd/modald-web.service "${unit}")
  install(FILES ${CMAKE_BINARY_DIR}/systemd/modald-web.service DESTINATION lib/systemd/system)
  install(FILES ${S}/modald-web.8 DESTINATION ${CMAKE_INSTALL_MANDIR}/man8)
  install(FILES ${S}/prometheus/modald.rules.yml ${S}/prometheus/modald-grafana.json ${CMAKE_SOURCE_DIR}/clients/web/page.png
    DESTINATION ${CMAKE_INSTALL_DATADIR}/modald-web)
endif()
install(FILES ${S}/modald.sysusers DESTINATION lib/sysusers.d RENAME modald.conf)
install(FILES ${S}/modald.tmpfiles DESTINATION lib/tmpfiles.d RENAME modald.conf)
install(FILES ${S}/modald.conf DESTINATION ${etc}/modald)
install(FILES ${S}/modald.8 ${S}/modald-worker.8 ${CMAKE_SOURCE_DIR}/clients/slurm/modald-slurm.8 DESTINATION ${CMAKE_INSTALL_MANDIR}/man8)
install(FILES ${CMAKE_SOURCE_DIR}/clients/ctl/modalctl.1 ${C}/examples/modald-rosco-bridge.1 ${C}/examples/modald-mbdyn-listener.1
  DESTINATION ${CMAKE_INSTALL_MANDIR}/man1)
install(FILES ${manual_pages} DESTINATION ${CMAKE_INSTALL_MANDIR}/man5)
file(GLOB tutorials CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/clients/ctl/*.7)
install(FILES ${tutorials} DESTINATION ${CMAKE_INSTALL_MANDIR}/man7)
install(FILES ${C}/modald_stream.3 DESTINATION ${CMAKE_INSTALL_MANDIR}/man3)
install(FILES ${CMAKE_SOURCE_DIR}/clients/ctl/modalctl.bash DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions RENAME modalctl)
install(FILES ${CMAKE_SOURCE_DIR}/clients/ctl/modalctl.zsh DESTINATION ${CMAKE_INSTALL_DATADIR}/zsh/vendor-completions RENAME _modalctl)
install(FILES ${CMAKE_SOURCE_DIR}/clients/ctl/modalctl.fish DESTINATION ${CMAKE_INSTALL_DATADIR}/fish/vendor_completions.d)
install(DIRECTORY ${CMAKE_SOURCE_DIR}/clients/python/modald DESTINATION ${python}
  FILES_MATCHING PATTERN "*.py" PATTERN "py.typed" PATTERN "__pycache__" EXCLUDE)
install(DIRECTORY ${CMAKE_SOURCE_DIR}/proto/ DESTINATION ${CMAKE_INSTALL_DOCDIR}/proto)
install(FILES ${CMAKE_SOURCE_DIR}/README.md ${CMAKE_SOURCE_DIR}/LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR})
