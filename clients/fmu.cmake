# The monitor as an FMI 2.0 co-simulation unit: modald-monitor.fmu, with as many inputs as MODALD_FMU_INPUTS says.
set(MODALD_FMU_INPUTS 8 CACHE STRING "inputs u[1] ... u[n] of modald-monitor.fmu")
if(NOT MODALD_FMU_INPUTS MATCHES "^[1-9][0-9]?[0-9]?[0-9]?$")
  message(FATAL_ERROR "MODALD_FMU_INPUTS is \"${MODALD_FMU_INPUTS}\"; accepted: 1 to 9999")
endif()
set(F ${CMAKE_BINARY_DIR}/fmu)
set(guid "{modald-monitor-2.0-${MODALD_FMU_INPUTS}}")
add_library(modald_monitor MODULE ${C}/examples/fmu/monitor.c)
target_compile_definitions(modald_monitor PRIVATE MODALD_FMU_INPUTS=${MODALD_FMU_INPUTS} MODALD_FMU_GUID="${guid}")
target_compile_options(modald_monitor PRIVATE -fvisibility=hidden -Wno-unused-parameter)
target_link_libraries(modald_monitor PRIVATE house modald_stream_static)
target_link_options(modald_monitor PRIVATE -Wl,--exclude-libs,ALL -Wl,-z,nodelete)    # a thread may still be in it
set_target_properties(modald_monitor PROPERTIES PREFIX "" LIBRARY_OUTPUT_DIRECTORY ${F}/binaries/linux64)

# Outputs come first, so that their indices do not depend on the inputs' number.
set(variables "")
foreach(row "frequency_hz 10 Hz" "frequency_std 11 Hz" "damping_ratio 12 1" "damping_std 13 1")
  string(REPLACE " " ";" row "${row}")
  list(GET row 0 name)
  list(GET row 1 reference)
  string(APPEND variables "    <ScalarVariable name=\"${name}\" valueReference=\"${reference}\" causality=\"output\"><Real/></ScalarVariable>\n")
endforeach()
string(APPEND variables "    <ScalarVariable name=\"verdict\" valueReference=\"14\" causality=\"output\" variability=\"discrete\"><Integer/></ScalarVariable>\n"
  "    <ScalarVariable name=\"dt\" valueReference=\"1\" causality=\"parameter\" variability=\"fixed\"><Real start=\"0.01\"/></ScalarVariable>\n"
  "    <ScalarVariable name=\"window\" valueReference=\"2\" causality=\"parameter\" variability=\"fixed\"><Integer start=\"0\"/></ScalarVariable>\n"
  "    <ScalarVariable name=\"hop\" valueReference=\"3\" causality=\"parameter\" variability=\"fixed\"><Integer start=\"0\"/></ScalarVariable>\n")
foreach(i RANGE 1 ${MODALD_FMU_INPUTS})
  math(EXPR reference "99 + ${i}")
  string(APPEND variables "    <ScalarVariable name=\"u[${i}]\" valueReference=\"${reference}\" causality=\"input\"><Real start=\"0\"/></ScalarVariable>\n")
endforeach()
file(CONFIGURE OUTPUT ${F}/modelDescription.xml CONTENT [[<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="modald-monitor" guid="@guid@" variableNamingConvention="structured"
    description="frequency, damping and stability of what comes in, by modald">
  <CoSimulation modelIdentifier="modald_monitor" canHandleVariableCommunicationStepSize="true"/>
  <ModelVariables>
@variables@  </ModelVariables>
  <ModelStructure>
    <Outputs><Unknown index="1"/><Unknown index="2"/><Unknown index="3"/><Unknown index="4"/><Unknown index="5"/></Outputs>
  </ModelStructure>
</fmiModelDescription>
]] @ONLY)
add_custom_command(OUTPUT ${CMAKE_BINARY_DIR}/modald-monitor.fmu
  COMMAND ${CMAKE_COMMAND} -E tar cf ${CMAKE_BINARY_DIR}/modald-monitor.fmu --format=zip modelDescription.xml binaries
  WORKING_DIRECTORY ${F} DEPENDS modald_monitor ${F}/modelDescription.xml VERBATIM)
add_custom_target(monitor_fmu ALL DEPENDS ${CMAKE_BINARY_DIR}/modald-monitor.fmu)
