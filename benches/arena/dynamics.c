// Mechanisms as lists of elements, each with one value: their equations of motion, a simulation under inputs that are held between
// samples (RK4), with or without a controller, and the rows of their inverse dynamics. Independent of tpm. Built by `dynamics.py`.
#include <math.h>
#include <string.h>

enum { INERTIA, LINK_INERTIA, LINK_MOMENT, SPRING, CUBIC, DAMPER, DRAG, FRICTION, INPUT, COGGING, PLACE_FRICTION, OFFSET };
enum { N = 8 };

typedef struct {
    int n, inputs, elements, links, cart; // links hang in series, from the ground or from a cart (-1: no cart)
    int coordinate[N];                    // of every link: its angle against the link before
    double length[N], smooth[N];          // of every link; rate below which dry friction falls to zero, of every coordinate
    double gravity;
} Machine;

typedef struct {
    int kind, i, j;   // j = -1: against the ground
    double first, second; // SPRING: half a gap; LINK_MOMENT: acts on inertia, acts on gravity (0 or 1); COGGING: wave number
} Element;

static double beyond(double x, double gap) { return x > gap ? x - gap : x < -gap ? x + gap : 0; }

// Mass matrix and the forces on the left of `M a + h = 0`, inputs included.
static void terms(const Machine *m, const Element *e, const double *theta, const double *q, const double *v, const double *u,
                  double M[N][N], double *h)
{
    double A[N][N], b[N], rate[N], s[N], c[N], sum = 0, turn = 0;
    int moving = m->links > 0;
    memset(A, 0, sizeof A), memset(b, 0, sizeof b);
    for (int i = 0; i < m->n; i++) memset(M[i], 0, N * sizeof(double)), h[i] = 0;
    for (int k = 0; k < m->links; k++) {
        sum += q[m->coordinate[k]], rate[k] = turn += v[m->coordinate[k]];
        s[k] = sin(sum), c[k] = cos(sum);
    }
    for (int x = 0; x < m->elements; x++) {
        const Element *own = e + x;
        double p = theta[x];
        int i = own->i, j = own->j;
        if (p == 0) continue;
        double d = 0, w = 0, f = 0;
        if (own->kind != LINK_INERTIA && own->kind != LINK_MOMENT) d = q[i] - (j < 0 ? 0 : q[j]), w = v[i] - (j < 0 ? 0 : v[j]);
        switch (own->kind) {
        case INERTIA: M[i][i] += p; break;
        case LINK_INERTIA: A[i][i] += p; break;
        case LINK_MOMENT:
            for (int k = 0; k < i && own->first != 0; k++) {
                double cosine = c[k] * c[i] + s[k] * s[i], sine = s[k] * c[i] - c[k] * s[i], a = p * m->length[k];
                A[k][i] += a * cosine, A[i][k] += a * cosine;
                b[k] += a * sine * rate[i] * rate[i], b[i] -= a * sine * rate[k] * rate[k];
            }
            if (m->cart >= 0 && own->first != 0)
                A[m->links][i] += p * c[i], A[i][m->links] += p * c[i], b[m->links] -= p * s[i] * rate[i] * rate[i];
            b[i] += own->second * m->gravity * p * s[i];
            break;
        case SPRING: f = p * beyond(d, own->first); break;
        case CUBIC: f = p * d * d * d; break;
        case DAMPER: f = p * w; break;
        case DRAG: f = p * w * fabs(w); break;
        case FRICTION: f = p * w / sqrt(w * w + m->smooth[i] * m->smooth[i]); break;
        case PLACE_FRICTION: f = p * d * w / sqrt(w * w + m->smooth[i] * m->smooth[i]); break;
        case COGGING: f = p * sin(own->first * d); break;
        case OFFSET: f = -p; break;
        case INPUT: f = -p * u[(int)own->first]; j = -1; break;
        }
        h[i] += f;
        if (j >= 0) h[j] -= f;
    }
    if (!moving) return;
    // Angles against the vertical are sums of the coordinates: the transposed sums bring rows back to joints.
    for (int k = m->links - 2; k >= 0; k--) {
        b[k] += b[k + 1];
        for (int l = 0; l <= m->links; l++) A[k][l] += A[k + 1][l];
    }
    for (int l = m->links - 2; l >= 0; l--)
        for (int k = 0; k <= m->links; k++) A[k][l] += A[k][l + 1];
    int extent = m->links + (m->cart >= 0);
    for (int k = 0; k < extent; k++) {
        int row = k < m->links ? m->coordinate[k] : m->cart;
        h[row] += b[k];
        for (int l = 0; l < extent; l++) M[row][l < m->links ? m->coordinate[l] : m->cart] += A[k][l];
    }
}

static void acceleration(const Machine *m, const Element *e, const double *theta, const double *q, const double *v, const double *u,
                         double *a)
{
    double M[N][N], h[N];
    terms(m, e, theta, q, v, u, M, h);
    for (int i = 0; m->links == 0 && i < m->n; i++) a[i] = M[i][i] > 0 ? -h[i] / M[i][i] : NAN;
    for (int i = 0; m->links > 0 && i < m->n; i++) { // Cholesky
        for (int j = 0; j <= i; j++) {
            double x = M[i][j];
            for (int k = 0; k < j; k++) x -= M[i][k] * M[j][k];
            M[i][j] = i == j ? (x > 0 ? sqrt(x) : NAN) : x / M[j][j];
        }
        a[i] = -h[i];
        for (int k = 0; k < i; k++) a[i] -= M[i][k] * a[k];
        a[i] /= M[i][i];
    }
    for (int i = m->n - 1; m->links > 0 && i >= 0; i--) {
        for (int k = i + 1; k < m->n; k++) a[i] -= M[k][i] * a[k];
        a[i] /= M[i][i];
    }
}

static void step(const Machine *m, const Element *e, const double *theta, double *q, double *v, const double *u, double t)
{
    double k1[N], k2[N], k3[N], k4[N], x[N], y[N];
    int n = m->n;
    acceleration(m, e, theta, q, v, u, k1);
    for (int i = 0; i < n; i++) x[i] = q[i] + t / 2 * v[i], y[i] = v[i] + t / 2 * k1[i];
    acceleration(m, e, theta, x, y, u, k2);
    for (int i = 0; i < n; i++) x[i] = q[i] + t / 2 * v[i] + t * t / 4 * k1[i], y[i] = v[i] + t / 2 * k2[i];
    acceleration(m, e, theta, x, y, u, k3);
    for (int i = 0; i < n; i++) x[i] = q[i] + t * v[i] + t * t / 2 * k2[i], y[i] = v[i] + t * k3[i];
    acceleration(m, e, theta, x, y, u, k4);
    for (int i = 0; i < n; i++) {
        q[i] += t * v[i] + t * t / 6 * (k1[i] + k2[i] + k3[i]);
        v[i] += t / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]);
    }
}

// What lies between a recorded input and its force, and between the motion and its reading.
typedef struct {
    int late;              // substeps by which inputs act late
    double dead[N];        // half a dead zone, of every input
    double play[N], count[N]; // half a backlash before the sensor, a count of the encoder (0: none), of every coordinate
} Channel;

// Closed loop where `reference` is given: proportional to the error, and to the error's filtered rate, of the coordinate of every
// input. Writes readings and inputs; otherwise plays `inputs`. Returns 0, or 1 when the motion left every bound.
int simulate(const Machine *m, const Element *e, const double *theta, const Channel *channel, int samples, int substeps, double sample,
             const double *q0, const double *v0, const double *noise, const double *reference, const int *driven, const double *kp,
             const double *kd, double filter, double *inputs, double *readings)
{
    double q[N], v[N], held[N], before[N], slope[N], acting[N] = { 0 }, h = sample / substeps;
    int n = m->n;
    memset(slope, 0, sizeof slope);
    for (int i = 0; i < n; i++) q[i] = held[i] = q0[i], v[i] = v0[i];
    for (int s = 0; s < samples; s++) {
        double *y = readings + s * n, *u = inputs + s * m->inputs;
        for (int i = 0; i < n; i++) {
            double x = q[i];
            if (channel && channel->play[i] > 0) x = held[i] += beyond(q[i] - held[i], channel->play[i]);
            if (noise) x += noise[s * n + i];
            if (channel && channel->count[i] > 0) x = channel->count[i] * round(x / channel->count[i]);
            y[i] = x;
            if (!(fabs(x) < 1e4)) return 1;
        }
        for (int k = 0; reference && k < m->inputs; k++) {
            double error = reference[s * m->inputs + k] - y[driven[k]];
            if (s > 0) slope[k] += sample / (filter + sample) * ((error - before[k]) / sample - slope[k]);
            before[k] = error;
            u[k] = kp[k] * error + kd[k] * slope[k];
        }
        for (int x = 0; x < substeps; x++) {
            int late = s * substeps + x - (channel ? channel->late : 0);
            const double *source = late < 0 ? inputs : inputs + late / substeps * m->inputs;
            for (int k = 0; k < m->inputs; k++) acting[k] = beyond(source[k], channel ? channel->dead[k] : 0);
            step(m, e, theta, q, v, acting, h);
        }
    }
    return 0;
}

// What every element asks for at unit value, row by row: `rows[sample][coordinate][element]`; inputs count as forces of their own.
void rows(const Machine *m, const Element *e, int samples, const double *q, const double *v, const double *a, const double *u, double *out)
{
    for (int s = 0; s < samples; s++)
        for (int x = 0; x < m->elements; x++) {
            double M[N][N], h[N], one = 1;
            Machine single = *m;
            single.elements = 1;
            terms(&single, e + x, &one, q + s * m->n, v + s * m->n, u + s * m->inputs, M, h);
            for (int i = 0; i < m->n; i++) {
                double f = h[i];
                for (int j = 0; j < m->n; j++) f += M[i][j] * a[s * m->n + j];
                out[(s * m->n + i) * m->elements + x] = f;
            }
        }
}

void mass(const Machine *m, const Element *e, const double *theta, const double *q, double *out)
{
    double M[N][N], h[N], zero[N] = { 0 };
    terms(m, e, theta, q, zero, zero, M, h);
    for (int i = 0; i < m->n; i++)
        for (int j = 0; j < m->n; j++) out[i * m->n + j] = M[i][j];
}
