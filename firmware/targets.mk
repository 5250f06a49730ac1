# Made from boards/targets.toml by `make generate`; edit that file.

standard := -std=c99 -ffp-contract=off -fno-math-errno
TARGETS := cortex-m4f cortex-m7 stm32f405 netduinoplus2 rv32imafc rv32imac

cpu_cortex-m4f := -mcpu=cortex-m4 -mfpu=fpv4-sp-d16 -mthumb -mfloat-abi=hard
board_cortex-m4f := start_cortex_m.c string.c systick.c simulated.c
script_cortex-m4f := mps2-an386.ld
clock_cortex-m4f := 25000000
machine_cortex-m4f := qemu-system-arm -M mps2-an386
cross_cortex-m4f := arm-none-eabi-
clang_cortex-m4f := thumbv7em-none-eabihf

cpu_cortex-m7 := -mcpu=cortex-m7 -mfpu=fpv5-d16 -mthumb -mfloat-abi=hard
board_cortex-m7 := start_cortex_m.c string.c systick.c simulated.c
script_cortex-m7 := mps2-an386.ld
clock_cortex-m7 := 25000000
machine_cortex-m7 := qemu-system-arm -M mps2-an500
cross_cortex-m7 := arm-none-eabi-
clang_cortex-m7 := thumbv7em-none-eabihf

cpu_stm32f405 := -mcpu=cortex-m4 -mfpu=fpv4-sp-d16 -mthumb -mfloat-abi=hard
board_stm32f405 := start_cortex_m.c string.c systick.c stm32f405.c
script_stm32f405 := stm32f405.ld
clock_stm32f405 := 16000000
cross_stm32f405 := arm-none-eabi-
clang_stm32f405 := thumbv7em-none-eabihf

cpu_netduinoplus2 := -mcpu=cortex-m4 -mfpu=fpv4-sp-d16 -mthumb -mfloat-abi=hard
board_netduinoplus2 := start_cortex_m.c string.c systick.c simulated.c
script_netduinoplus2 := stm32f405.ld
clock_netduinoplus2 := 168000000
machine_netduinoplus2 := qemu-system-arm -M netduinoplus2
cross_netduinoplus2 := arm-none-eabi-
clang_netduinoplus2 := thumbv7em-none-eabihf

cpu_rv32imafc := -march=rv32imafc -mabi=ilp32f -mcmodel=medany
board_rv32imafc := start_rv32.c string.c clint.c simulated.c
script_rv32imafc := virt.ld
machine_rv32imafc := qemu-system-riscv32 -M virt -cpu rv32 -bios none
cross_rv32imafc := riscv64-unknown-elf-
clang_rv32imafc := riscv32-unknown-elf

cpu_rv32imac := -march=rv32imac -mabi=ilp32 -mcmodel=medany
board_rv32imac := start_rv32.c string.c clint.c simulated.c
script_rv32imac := virt.ld
machine_rv32imac := qemu-system-riscv32 -M virt -cpu rv32,f=false,d=false -bios none
cross_rv32imac := riscv64-unknown-elf-
clang_rv32imac := riscv32-unknown-elf
