// SPDX-License-Identifier: MIT
// The board behind a part of the probe: what main.c gave it or, where the build names a
// header of it as PORTS_FIXED, what the compiler sees there, so that calls are direct.
#ifndef PORTS_OF_H
#define PORTS_OF_H

#ifdef PORTS_FIXED
#define STRING_OF(name) #name
#define HEADER(name) STRING_OF(name)
#include HEADER(PORTS_FIXED)
#define ACQUISITION_PORT(acquisition) ((void)(acquisition), &acquisition_port)
#define PROBE_PORT(probe) ((void)(probe), &probe_port)
#define BUS_PORT(bus) ((void)(bus), &BOARD_BUS)
#define MEMORY_PORT(memory) ((void)(memory), &BOARD_MEMORY)
#define OUTLET_PUT(outlet) board_send
#define SET_PORT(part, given) ((void)(given))
#else
#define ACQUISITION_PORT(acquisition) ((acquisition)->port)
#define PROBE_PORT(probe) ((probe)->port)
#define BUS_PORT(bus) (bus)
#define MEMORY_PORT(memory) (memory)
#define OUTLET_PUT(outlet) ((outlet)->put)
#define SET_PORT(part, given) ((part)->port = (given))
#endif

#endif
