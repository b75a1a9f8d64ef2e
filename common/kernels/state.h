/* Written by header.py; change the Protocols and constants of ../estimation. */
#pragma once

enum { RING = 8192, STOPS = 8, COUNT = 42, FIRST_STOP = 5, FIRST_RELAXATION = 13, FIRST_DIFFERENCE = 19,
    FIRST_NONLINEAR = 34, RELAXATIONS = 3, DIFFERENCES = 5, THEN = 42, HELD = 83, PAST = 84, STEP = 90,
    ROW = 102, PLAIN = 3, ODD = 4, LAGS = 6, EXPERTS = 5, MEMBERS = 8, RIVALS = 3, ZOH = 0, FIRST_EXPERT = 1,
    CONTACT = 6, FIRST_FORCES = 3, BINS = 128, ZERO_BIN = 64, PER_OCTAVE = 8, NODES = 32,
    WORSE_THAN_NOTHING = -2 };
static const double GAP_S = 0.1;
static const double NO_OCTAVE = -9999.0;
static const int SPANS[] = {1, 2, 4, 8, 16};
static const double RELAXATIONS_S[] = {0.1, 1.0, 10.0};
static const double LAGS_S[] = {0.03, 0.06, 0.1, 0.2, 0.4, 0.8};

typedef struct {
    double count;
    double start;
    double origin_m;
    double low_m;
    double high_m;
    double octave;
    double v;
    double a;
    double speed2;
    double speed_s;
    double period_s;
    double fastest_m_s;
    double median_m;
    double began_m;
    double suspect_m;
    double rest_m;
    double moved_s;
    double restart;
    double stops_m[8];
    double radii_m[8];
    double slow_m[3];
    double slow_friction[3];
    double periods_s[8192];
    double octaves[8192];
    double since_moved_s[8192];
    double t_s[8192];
    double x_m[8192];
    double phi[8192][42];
} Bank;

typedef struct {
    double known;
    double low_n;
    double high_n;
    double first_n;
    double before_n;
    double suspect_s;
    double suspect_n;
    double admitted[2][2];
} Forces;

typedef struct {
    double newest;
    double newest_s;
    double held_n;
    double received;
    double renewals;
    double taught_n;
    Bank bank;
    Forces forces;
    double received_s[8192];
    double received_n[8192];
    double stage[8192][3];
    double contact_n[8192];
    double steadily_n[8192];
    double residual_n[8192];
    double rows[8192][102];
    double members_n[8192][8];
    double others_n[8192];
    double force_n[8192];
    double half_n[8192];
    double scale_n[8192];
    double known_row[1][102];
} Evaluation;

typedef struct {
    double renewals;
    double known_s;
    double first_n;
    double low_n;
    double high_n;
    double largest_n;
    double reach_n;
    double recent_n;
    double factor;
    double taught;
    double persistence;
    double radii_m[8];
    double theta[5][102];
    double weights[8];
} Learned;

typedef struct {
    double weight_s;
    double solved_s;
    double radii_m[8];
    double information[102][102];
    double moments[2][102];
    double theta[5][102];
    double factor[102][102];
    double solution[102];
} Learning;

typedef struct {
    double seen_fast;
    double seen_slow;
    double zoh_n2;
    double informed_n2;
    double known_s;
    double largest_n;
    double reach_n;
    double unexplained_n;
    double residual_n2;
    double persistent_n2;
    double persistence;
    double taught;
    double losses[2][8];
    double weights[8];
    double rivals_n2[3];
} Blend;

typedef struct {
    double errors;
    double weight;
    double seen_s;
    double shift;
    double scores[128];
} Band;

typedef struct {
    double usual;
    double weight;
    double now;
    double now_weight;
    double clock_s;
    double since_s;
} Change;

typedef struct {
    double seconds;
    double predicted_n2;
    double held_n2;
    double low_n;
    double high_n;
    double low_before_n;
    double high_before_n;
    double failed;
} Trial;

typedef struct {
    double octave;
    double predicted_n2;
    double zoh_n2;
    Forces forces;
    Learning experts;
    Blend blend;
    Band band;
    Change change;
    Trial trial;
    double taken[8192];
} Knowledge;

typedef struct {
    double t_s;
    double x_m;
    double stage_m;
    double v_m_s;
    double a_m_s2;
    double contact_n;
    double steadily_n;
    double taught_n;
} OwnMotion;

typedef struct {
    double stamp_s;
    double force_n;
} Reading;

typedef struct {
    double force_n;
    double half_n;
    double leading;
} Predicted;

static const struct { const char *name; long size; } RECORDS[] = { {"Bank", sizeof(Bank)},
    {"Forces", sizeof(Forces)}, {"Evaluation", sizeof(Evaluation)}, {"Learned", sizeof(Learned)},
    {"Learning", sizeof(Learning)}, {"Blend", sizeof(Blend)}, {"Band", sizeof(Band)},
    {"Change", sizeof(Change)}, {"Trial", sizeof(Trial)}, {"Knowledge", sizeof(Knowledge)},
    {"OwnMotion", sizeof(OwnMotion)}, {"Reading", sizeof(Reading)}, {"Predicted", sizeof(Predicted)} };
