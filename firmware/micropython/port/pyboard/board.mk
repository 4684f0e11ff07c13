# SPDX-License-Identifier: MIT
# The STM32F405 of a pyboard: what firmware/stm32 has for clock, wire, bus and flash.
STM32 := start clock reset flash journal adc uart i2c
MACHINE := -mthumb -mcpu=cortex-m4 -mfloat-abi=hard -mfpu=fpv4-sp-d16

CFLAGS += $(MACHINE) -O2 -fsingle-precision-constant -DF_CPU=168000000L
CFLAGS += -I$(FIRMWARE) -I$(FIRMWARE)/stm32
LDFLAGS += $(MACHINE) -nostartfiles --specs=nano.specs -T pyboard/pyboard.ld
LIB := -lm
LINKED := pyboard/pyboard.ld
BOARD_O := $(STM32:%=$(BUILD)/stm32/%.o) $(BUILD)/stm32/bus_recovery.o
BOARD_O += $(BUILD)/$(NAME)_rom.o

$(BUILD)/stm32/%.o: $(FIRMWARE)/stm32/%.c
	$(Q)$(MKDIR) -p $(@D)
	$(Q)$(CC) $(CFLAGS) -c -o $@ $<

$(BUILD)/stm32/%.o: $(FIRMWARE)/generic/%.c
	$(Q)$(MKDIR) -p $(@D)
	$(Q)$(CC) $(CFLAGS) -c -o $@ $<

$(BUILD)/$(NAME)_rom.o: $(ROM)
	$(Q)$(CC) $(CFLAGS) -c -o $@ $<
