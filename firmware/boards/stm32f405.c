/*
 * stm32f405.c - a real board: encoders on TIM2 and TIM3, motor bridges on TIM1, the independent watchdog. The clock is the internal
 * one, 16 MHz, as after reset; the tick is in systick.c.
 *
 *     right encoder  PA0, PA1    bridge  PA8 (PWM), PB0 (high: backward)
 *     left encoder   PA6, PA7            PA9 (PWM), PB1 (high: backward)
 *     telemetry      PA2, USART2, 500 kBd, 8N1
 *
 * Until board_start all pins are inputs. The bridges require pull-down resistors, so that the motors are off until then.
 */
#include "../board.h"
#include "clock.h"

#define SUPPLY 24.0f /* V, of the bridges; use the measured battery voltage if available */
#define PWM 800      /* counts per period, 20 kHz */
#define ROOM 256u    /* bytes of telemetry that are sent at a time */
#define BAUD 32      /* 16 MHz / 32: 500 kBd */
#define LATE 5.0f    /* ticks without board_alive after which the watchdog resets */

#define REGISTER(address) (*(volatile uint32_t *)(address))

#define RCC_AHB1ENR REGISTER(0x40023830u)
#define RCC_APB1ENR REGISTER(0x40023840u)
#define RCC_APB2ENR REGISTER(0x40023844u)
#define RCC_CSR REGISTER(0x40023874u)

#define GPIOA_MODER REGISTER(0x40020000u)
#define GPIOA_PUPDR REGISTER(0x4002000cu)
#define GPIOA_AFRL REGISTER(0x40020020u)
#define GPIOA_AFRH REGISTER(0x40020024u)
#define GPIOB_MODER REGISTER(0x40020400u)
#define GPIOB_BSRR REGISTER(0x40020418u)

#define TIM1 0x40010000u
#define TIM2 0x40000000u
#define TIM3 0x40000400u
#define TIM_CR1(timer) REGISTER((timer) + 0x00u)
#define TIM_SMCR(timer) REGISTER((timer) + 0x08u)
#define TIM_EGR(timer) REGISTER((timer) + 0x14u)
#define TIM_CCMR1(timer) REGISTER((timer) + 0x18u)
#define TIM_CCER(timer) REGISTER((timer) + 0x20u)
#define TIM_CNT(timer) REGISTER((timer) + 0x24u)
#define TIM_PSC(timer) REGISTER((timer) + 0x28u)
#define TIM_ARR(timer) REGISTER((timer) + 0x2cu)
#define TIM_CCR1(timer) REGISTER((timer) + 0x34u)
#define TIM_CCR2(timer) REGISTER((timer) + 0x38u)
#define TIM_BDTR(timer) REGISTER((timer) + 0x44u)

#define USART2_DR 0x40004404u
#define USART2_BRR REGISTER(0x40004408u)
#define USART2_CR1 REGISTER(0x4000440cu)
#define USART2_CR3 REGISTER(0x40004414u)
#define DMA1_HIFCR REGISTER(0x4002600cu)
#define DMA1_S6CR REGISTER(0x400260a0u) /* stream 6, channel 4: USART2 sends */
#define DMA1_S6NDTR REGISTER(0x400260a4u)
#define DMA1_S6PAR REGISTER(0x400260a8u)
#define DMA1_S6M0AR REGISTER(0x400260acu)
#define DMA_ENABLED 1u
#define DMA_SENDS 0x08000440u /* channel 4, from memory, whose address counts up; bytes; no interrupts */

#define IWDG_KR REGISTER(0x40003000u)
#define IWDG_PR REGISTER(0x40003004u)
#define IWDG_RLR REGISTER(0x40003008u)

static void encoder_start(uint32_t timer)
{
    TIM_ARR(timer) = 0xffff;   /* 16 bits, also of TIM2, which has 32 */
    TIM_CCMR1(timer) = 0x3131; /* inputs 1 and 2 from their own pins; filter: a level must last 8 clocks */
    TIM_SMCR(timer) = 3;       /* count every edge of both */
    TIM_CR1(timer) = 1;
}

static void bridges_start(void)
{
    TIM_PSC(TIM1) = 0;
    TIM_ARR(TIM1) = PWM - 1;
    TIM_CCMR1(TIM1) = 0x6868; /* outputs 1 and 2: high while the counter is below CCR, which is updated between periods */
    TIM_CCR1(TIM1) = 0;
    TIM_CCR2(TIM1) = 0;
    TIM_CCER(TIM1) = 0x11;
    TIM_BDTR(TIM1) = 0x8000; /* all outputs on */
    TIM_EGR(TIM1) = 1;       /* load these values */
    TIM_CR1(TIM1) = 0x81;
}

static void pins_start(void)
{
    GPIOA_PUPDR |= 0x5005;                                    /* PA0, 1, 6, 7: pull-up, for encoders with open collectors */
    GPIOA_AFRL = (GPIOA_AFRL & ~0xff000fffu) | 0x22000711u;   /* PA0, 1: TIM2; PA2: USART2; PA6, 7: TIM3 */
    GPIOA_AFRH = (GPIOA_AFRH & ~0x000000ffu) | 0x00000011u;   /* PA8, 9: TIM1 */
    GPIOA_MODER = (GPIOA_MODER & ~0x000ff03fu) | 0x000aa02au; /* all seven: alternate function */
    GPIOB_MODER = (GPIOB_MODER & ~0x0000000fu) | 0x00000005u; /* PB0, 1: outputs */
}

static void line_start(void)
{
    USART2_BRR = BAUD;
    USART2_CR3 = 0x80;   /* bytes come by DMA */
    USART2_CR1 = 0x2008; /* on, sends */
    DMA1_S6PAR = USART2_DR;
}

static void watchdog_start(float period)
{
    IWDG_KR = 0x5555; /* enable writing */
    IWDG_PR = 3;      /* 32 kHz / 32: counts in ms */
    IWDG_RLR = (uint32_t)(period * LATE * 1000) + 1;
    IWDG_KR = 0xcccc; /* on, until the next reset */
}

int board_start(float period)
{
    const int restarted = (RCC_CSR & 0x20000000u) != 0; /* the last reset came from the watchdog */
    RCC_CSR |= 0x01000000u;                             /* clear this flag */
    RCC_AHB1ENR |= 0x200003;                            /* GPIOA, B; DMA1 */
    RCC_APB1ENR |= 0x20003;                             /* TIM2, 3; USART2 */
    RCC_APB2ENR |= 0x1;                                 /* TIM1 */
    encoder_start(TIM2);
    encoder_start(TIM3);
    bridges_start();
    line_start();
    pins_start();
    watchdog_start(period);
    clock_start(period);
    return restarted ? BOARD_RESTARTED : 0;
}

uint32_t board_wait(void)
{
    return clock_wait();
}

void board_read(uint32_t counts[2])
{
    counts[0] = TIM_CNT(TIM2);
    counts[1] = TIM_CNT(TIM3);
}

void board_drive(const float command[2])
{
    const float right = command[0] * (PWM / SUPPLY), left = command[1] * (PWM / SUPPLY);
    GPIOB_BSRR = (right < 0 ? 0x1u : 0x10000u) | (left < 0 ? 0x2u : 0x20000u);
    TIM_CCR1(TIM1) = (uint32_t)(right < 0 ? -right : right);
    TIM_CCR2(TIM1) = (uint32_t)(left < 0 ? -left : left);
}

/* All or nothing: the previous bytes have been sent or not. */
uint32_t board_room(void)
{
    return (DMA1_S6CR & DMA_ENABLED) != 0 ? 0 : ROOM;
}

void board_send(const uint8_t *bytes, uint32_t count)
{
    static uint8_t sent[ROOM]; /* read by the DMA until all are sent */
    uint32_t i;
    if (count == 0 || count > board_room()) {
        return;
    }
    for (i = 0; i < count; i++) {
        sent[i] = bytes[i];
    }
    DMA1_HIFCR = 0x3d0000u; /* clear the flags of stream 6 */
    DMA1_S6M0AR = (uint32_t)(uintptr_t)sent;
    DMA1_S6NDTR = count;
    DMA1_S6CR = DMA_SENDS;
    DMA1_S6CR = DMA_SENDS | DMA_ENABLED;
}

void board_alive(void)
{
    IWDG_KR = 0xaaaa;
}

/* Waits for ever and feeds the watchdog, so that it does not restart the program. With HAS_HOST defined (a debugger or QEMU), returns. */
int board_end(const board_report *report)
{
#if !defined(HAS_HOST)
    for (;;) {
        (void)clock_wait();
        board_alive();
    }
#endif
    return report->code;
}
